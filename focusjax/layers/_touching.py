"""Which triangles touch which squares of the grid, where few of its squares matter."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from focusjax._parallel import in_parallel
from focusjax.layers._boxes import Boxes, boxes_on
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._edges import Edges, edge_functions
from focusjax.layers._grid import Grid

_SAMPLES_AT_ONCE = 1 << 20
"""In the boxes that one call looks at, of which one may be larger."""
_SLACK = 1e-5
"""Samples by which a triangle is fattened, so that rounding loses nothing."""


@dataclasses.dataclass(frozen=True)
class Touching:
    """Pairs of a triangle and a square that it may touch.

    Attributes:
        square: index [n] of the square.
        sides: x, y and offset [n] of the distances to the triangle's sides, one side after the other, counted
            from the square's centre; see `_edges`.
        triangle: index [n] of the triangle.
        plane: its disparity [n] at the square's centre, and the change of that in x and in y.
    """

    square: np.ndarray
    sides: tuple[np.ndarray, ...]
    triangle: np.ndarray
    plane: tuple[np.ndarray, ...]


def touching(
    triangles: ScreenTriangles,
    grid: Grid,
    cell: Int[np.ndarray, " s"],
    low: Float[np.ndarray, " s"],
    high: Float[np.ndarray, " s"],
) -> Touching:
    """The triangles that touch squares and have a disparity between `low` and `high` at their centres.

    Args:
        triangles: on the grid.
        grid: theirs.
        cell: the grid sample of each square, in increasing order. Several may be in one place.
        low: least disparity at each.
        high: largest disparity at each.
    """
    count = np.bincount(cell, minlength=grid.size)
    before = np.zeros(grid.size + 1, dtype=np.int32)
    np.cumsum(count, out=before[1:])

    def some(boxes: Boxes) -> tuple[np.ndarray, ...]:
        x, y, w = triangles.around(boxes.triangle, boxes.column, boxes.row)
        edges = edge_functions(x, y, w, np)
        line = np.repeat(np.arange(len(boxes.triangle)), boxes.height)
        down = np.arange(len(line)) - np.take(np.cumsum(boxes.height) - boxes.height, line)
        first, end = _covered_lines(boxes, edges, line, down)
        start = np.take(boxes.row * grid.columns + boxes.column, line) + down * grid.columns
        # The squares in a line come one after the other.
        begin, times = np.take(before, start + first), np.take(before, start + end)
        times -= begin
        pair = np.repeat(np.arange(len(line)), times)
        square = np.arange(len(pair)) - np.take(np.cumsum(times) - times - begin, pair)
        right = np.take(cell, square) - np.take(start, pair)
        box, below = np.take(line, pair), np.take(down, pair)
        there, slope_x, slope_y = _disparity(edges, box, right, below)
        within = np.clip(there, *(np.take(end, box) for end in _extremes(w)))
        kept = np.flatnonzero((within >= np.take(low, square)) & (within <= np.take(high, square)))
        box, right, below = (np.take(a, kept) for a in (box, right, below))
        plane = np.take(there, kept), np.take(slope_x, box), np.take(slope_y, box)
        sides = []
        for across, along, offset, _ in edges:
            across, along = np.take(across, box), np.take(along, box)
            sides += [across, along, np.take(offset, box) + across * right + along * below]
        numbers = np.take(square, kept), np.take(boxes.triangle, box)
        return *numbers, *(a.astype(np.float32) for a in (*sides, *plane))

    work = [
        less
        for part in boxes_on(grid, triangles, wanted=count > 0)
        for less in part.portions(part.samples, _SAMPLES_AT_ONCE)
    ]
    nothing = (*[np.zeros(0, dtype=np.intp)] * 2, *[np.zeros(0, dtype=np.float32)] * 12)
    found = zip(nothing, *in_parallel(some, work), strict=True)
    square, triangle, *rest = (np.concatenate(a) for a in found)
    return Touching(square, tuple(rest[:9]), triangle, tuple(rest[9:]))


def _disparity(
    edges: Edges, box: np.ndarray, right: np.ndarray, below: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """That of the triangles in the boxes `box` [n], at places counted from the first sample of each.

    And its changes in x and in y, of all boxes.
    """
    # Of triangles without area there are no pairs, but infinite distances.
    with np.errstate(invalid="ignore"):
        slope_x, slope_y, there = (sum(edge[k] * edge[3] for edge in edges) for k in range(3))
    return (
        np.take(there, box) + np.take(slope_x, box) * right + np.take(slope_y, box) * below,
        slope_x,
        slope_y,
    )


def _extremes(values: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest of three [n]."""
    first, second, third = values
    least, most = (op(op(first, second), third) for op in (np.minimum, np.maximum))
    return least, most


def _covered_lines(
    boxes: Boxes, edges: Edges, line: np.ndarray, down: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First sample [n] whose square the triangle touches in each line of samples of its box, and the end."""
    left, right = np.zeros(len(line)), np.take(boxes.width - 1.0, line)
    for across, along, offset, _ in edges:
        # Inside is across x >= least.
        least = np.take(-_SLACK - offset - 0.5 * (np.abs(across) + np.abs(along)), line)
        least -= np.take(along, line) * down
        across = np.take(across, line) + 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            limit = least / across
        np.fmax(left, limit, out=left, where=across >= 0)
        np.fmin(right, limit, out=right, where=across < 0)
    end = np.floor(np.maximum(right, -1.0)).astype(np.int32) + 1
    return np.ceil(np.minimum(left, end)).astype(np.int32), end
