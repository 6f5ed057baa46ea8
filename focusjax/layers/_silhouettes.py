"""Where surfaces end inside the square of a sample.

A sample is held by the surface at its centre, so a silhouette would follow the squares of the samples. It
is put where it belongs, to a small share of a sample, by looking at all triangles that touch the squares
along it: those of samples whose surface does not continue to a neighbour, and those of the neighbours it
does not continue to. The part of a square that a surface covers is counted on 32 points, and a line that
leaves as much of the square on the side of their centroid stands for it. Where a surface reaches into a
square whose centre it misses, a fringe sample is added there.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, UInt

from focusjax.layers._cells import line_code
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid
from focusjax.layers._joins import NEIGHBOURS, UNJOINED, Joins, Planes
from focusjax.layers._touching import OFFSETS, POINTS, Band, in_bands, touching

_SIDES = 4


@dataclasses.dataclass(frozen=True)
class Silhouettes:
    """Lines of the samples that are there, and samples to add.

    Attributes:
        cut: which [c] of the held samples have a square that is not covered whole.
        line: code [c] of the line in each.
        cell: grid sample [f], row-major, of each fringe sample.
        source: which [f] of the held samples has the surface that reaches into it.
        disparity: 1/m [f] of that surface there.
        low: least disparity [f] that it spans there.
        high: largest disparity [f].
        fringe_line: code [f].
    """

    cut: np.ndarray
    line: np.ndarray
    cell: np.ndarray
    source: np.ndarray
    disparity: np.ndarray
    low: np.ndarray
    high: np.ndarray
    fringe_line: np.ndarray


class _Squares(NamedTuple):
    """Squares to look at: grid sample, held sample whose surface is meant, disparities that count as it."""

    cell: np.ndarray
    source: np.ndarray
    disparity: np.ndarray
    low: np.ndarray
    high: np.ndarray


def find_silhouettes(
    triangles: ScreenTriangles, grid: Grid, planes: Planes, joins: Joins, parallax: float
) -> Silhouettes:
    """The silhouettes of the layers that `planes` and `joins` describe; `parallax` in samples per dioptre."""
    small_step = 1.0 / max(parallax, 1e-12)
    own, beyond = _squares(grid, planes, joins, small_step)
    both = _Squares(*(np.concatenate(pair) for pair in zip(own, beyond, strict=True)))
    mask, centre = _covered_points(triangles, grid, both, 0.5 * small_step)
    count, number = np.bitwise_count(mask), len(own.cell)
    cut = np.flatnonzero((count[:number] > 0) & (count[:number] < POINTS))
    kept = np.flatnonzero((count[number:] > 0) & ~centre[number:])
    source = beyond.source[kept]
    steep = np.abs(planes.slope_x[source]) + np.abs(planes.slope_y[source])
    w, spread = beyond.disparity[kept], 0.5 * np.minimum(steep, small_step)
    return Silhouettes(
        cut=own.source[cut],
        line=_lines(mask[:number][cut]),
        cell=beyond.cell[kept],
        source=source,
        disparity=w,
        low=np.maximum(w - spread, 0),
        high=w + spread,
        fringe_line=_lines(mask[number:][kept]),
    )


def _lines(mask: UInt[np.ndarray, " n"]) -> UInt[np.ndarray, " n"]:
    """Codes of the lines that leave the points of each mask on one side."""
    bits = np.unpackbits(mask.view(np.uint8).reshape(-1, 4), axis=1, bitorder="little").astype(np.float32)
    return line_code(bits @ OFFSETS.astype(np.float32), bits.mean(axis=1))


def _squares(grid: Grid, planes: Planes, joins: Joins, small_step: float) -> tuple[_Squares, _Squares]:
    """Squares of samples with an open side, and those across their open sides."""
    opens = [((joins.links >> np.uint32(4 * side)) & 15) == UNJOINED for side in range(_SIDES)]
    source = np.flatnonzero(np.logical_or.reduce(opens))
    cell = planes.held[source] % grid.size
    own = _Squares(cell, source, planes.disparity[source], joins.low[source], joins.high[source])
    parts = []
    for side, (dx, dy) in enumerate(NEIGHBOURS[:_SIDES]):
        source = np.flatnonzero(opens[side])
        row, column = np.divmod(planes.held[source] % grid.size, grid.columns)
        inside = (column + dx >= 0) & (column + dx < grid.columns) & (row + dy >= 0) & (row + dy < grid.rows)
        source = source[inside]
        w = planes.disparity[source]
        step = np.clip(planes.slope_x[source] * dx + planes.slope_y[source] * dy, -small_step, small_step)
        there = np.maximum(w + step, 0.5 * w)
        cell = planes.held[source] % grid.size + dy * grid.columns + dx
        parts.append((cell, source, there, np.minimum(w, there), np.maximum(w, there)))
    beyond = [np.concatenate(column) for column in zip(*parts, strict=True)]
    # One surface may reach a square from several sides.
    order = np.lexsort((beyond[2], beyond[0]))
    beyond = [column[order] for column in beyond]
    cell, w = beyond[0], beyond[2]
    fresh = np.ones(len(cell), dtype=bool)
    fresh[1:] = (cell[1:] != cell[:-1]) | (w[1:] - w[:-1] > small_step)
    return own, _Squares(*(column[fresh] for column in beyond))


def _covered_points(
    triangles: ScreenTriangles, grid: Grid, squares: _Squares, tolerance: float
) -> tuple[UInt[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Points of each square that its surface covers, a bit each, and whether it covers the centre."""
    order = np.argsort(squares.cell, kind="stable")
    cell, low, high = (a[order] for a in (squares.cell, squares.low - tolerance, squares.high + tolerance))
    together = np.zeros(len(order), dtype=np.uint32)
    at_centre = np.zeros(len(order), dtype=bool)

    def look(band: Band) -> None:
        mine = band.squares
        found = touching(band, triangles, grid, cell[mine], low[mine], high[mine])
        np.bitwise_or.at(together[mine], found.square, found.points)
        at_centre[mine][found.square[found.centre]] = True

    in_bands(look, triangles, grid, cell)
    points, centre = np.empty_like(together), np.empty_like(at_centre)
    points[order], centre[order] = together, at_centre
    return points, centre
