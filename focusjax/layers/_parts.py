"""The parts of a sample's square that lie in different triangles of its surface.

Each square is looked at in 32 points. Part k is where triangle k is the nearest of those that belong to the
square's surface; its share of the square is that of the points in it, and its place is their centroid.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._parallel import in_parallel
from focusjax._programs import jit
from focusjax.layers._attributes import SurfaceSamples, surface_samples
from focusjax.layers._blocks import in_blocks, pad_rows, padded_length
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid
from focusjax.layers._touching import OFFSETS, POINTS, Band, touching

_AT_ONCE = 1 << 16
_PIECES_AT_ONCE, _MOST_IN_SQUARE = 1 << 14, 1 << 10
_FIRST, _ROUNDING = np.float32(1.0 + 4e-6), np.float32(1e-6)
"""By which a square's own triangle is nearer than others in the same place, and others may differ by."""


@dataclasses.dataclass(frozen=True)
class Squares:
    """Squares of samples, each with the surface that is meant there.

    Attributes:
        cell: grid sample [n], row-major; several may have the same.
        low: least disparity [n] of the surface there.
        high: largest disparity [n].
        triangle: index [n] of the triangle that a sample in the square is of; of several that lie in one
            place, it is the one that counts.
        clear: whether [n] the surface may be seen through; None where none may.
    """

    cell: np.ndarray
    low: np.ndarray
    high: np.ndarray
    triangle: np.ndarray
    clear: np.ndarray | None

    def take(self, index: Int[np.ndarray, " k"] | slice) -> "Squares":
        """The squares at the positions `index`."""
        clear = None if self.clear is None else self.clear[index]
        columns = (a[index] for a in (self.cell, self.low, self.high, self.triangle))
        return Squares(*columns, clear=clear)


@dataclasses.dataclass(frozen=True)
class Parts:
    """Parts of squares.

    Attributes:
        square: index [p] of the square of each.
        share: share [p] of the square.
        surface: attributes of the surface at their centroids.
    """

    square: np.ndarray
    share: np.ndarray
    surface: SurfaceSamples


def square_parts(
    band: Band,
    triangles: ScreenTriangles,
    grid: Grid,
    squares: Squares,
    clear: Bool[np.ndarray, " t"] | None,
) -> Parts:
    """The parts of the `squares` of a band, which are in the order of their cells.

    Those in which no triangle of their surface covers a point have none. `clear` says which of the scene's
    faces may be seen through; None if none may.
    """
    found = touching(band, triangles, grid, squares.cell, squares.low, squares.high)
    there = found.points > 0
    if clear is not None and squares.clear is not None:
        there &= clear[triangles.source[found.triangle]] == squares.clear[found.square]
    there = np.flatnonzero(there)
    square, points, triangle = (np.take(a, there) for a in (found.square, found.points, found.triangle))
    overlapping = _overlapping(square, points, len(squares.cell))
    points[overlapping] = _where_nearest(
        points[overlapping],
        [values[there[overlapping]] for values in found.plane],
        square[overlapping],
        triangle[overlapping] == squares.triangle[square[overlapping]],
    )
    seen = np.flatnonzero(points)
    square, triangle = square[seen], triangle[seen]
    place, share = in_blocks(_centroids, (points[seen],), _AT_ONCE)
    surface = surface_samples(triangles, squares.cell[square].astype(np.int32), triangle, grid, place)
    return Parts(square, share, surface)


def _overlapping(
    square: Int[np.ndarray, " p"], points: UInt[np.ndarray, " p"], count: int
) -> Int[np.ndarray, " k"]:
    """The pieces of those of `count` squares in which several cover a point, square by square."""
    covered = np.bincount(square, np.bitwise_count(points), count)
    unsure = np.flatnonzero((covered <= POINTS)[square])
    together = np.zeros(count, dtype=np.uint32)
    np.bitwise_or.at(together, square[unsure], points[unsure])
    several = np.flatnonzero((covered > np.bitwise_count(together))[square])
    return several[np.argsort(square[several], kind="stable")]


def _where_nearest(
    points: UInt[np.ndarray, " p"],
    plane: Sequence[Float[np.ndarray, " p"]],
    square: Int[np.ndarray, " p"],
    own: Bool[np.ndarray, " p"],
) -> UInt[np.ndarray, " p"]:
    """Points of each piece where its `plane` is the nearest of its square; the pieces of one are in a row.

    Of planes in one place those that are the square's `own` count.
    """

    def run(part: slice) -> np.ndarray:
        number = np.cumsum(np.diff(square[part], prepend=square[part.start]) > 0, dtype=np.int32)
        columns = points[part], *(values[part] for values in plane), number
        length = max(_PIECES_AT_ONCE, padded_length(part.stop - part.start))
        rows: Any = (pad_rows(a, length) for a in (*columns, own[part]))
        return np.asarray(_nearest(*rows))[: part.stop - part.start]

    return np.concatenate([np.zeros(0, dtype=np.uint32), *in_parallel(run, _whole_squares(square))])


@jit
def _nearest(
    points: UInt[Array, " p"],
    there: Float[Array, " p"],
    slope_x: Float[Array, " p"],
    slope_y: Float[Array, " p"],
    square: Int[Array, " p"],
    own: Bool[Array, " p"],
) -> UInt[Array, " p"]:
    """As `_where_nearest`, of squares that are numbered without gaps, for some thousand pieces."""
    offsets = jnp.asarray(OFFSETS, dtype=there.dtype)
    bit = jnp.arange(POINTS, dtype=jnp.uint32)[None]
    there, slope_x, slope_y = (values[:, None] for values in (there, slope_x, slope_y))
    disparity = there + slope_x * offsets[None, :, 0] + slope_y * offsets[None, :, 1]
    disparity *= jnp.where(own, _FIRST, 1.0)[:, None]
    disparity = jnp.where((points[:, None] >> bit) & 1 > 0, disparity, 0.0)
    nearest = jnp.zeros_like(disparity).at[square].max(disparity, mode="drop")[square]
    # Of what is as near to within rounding, which need not be the same in both places, the first counts.
    number = jnp.arange(len(square), dtype=jnp.int32)[:, None]
    won = jnp.where((disparity > 0) & (disparity >= nearest * (1.0 - _ROUNDING)), number, len(square))
    won = jnp.full_like(won, len(square)).at[square].min(won, mode="drop")[square] == number
    return (won.astype(jnp.uint32) << bit).sum(axis=1, dtype=jnp.uint32)


def _whole_squares(square: Int[np.ndarray, " p"]) -> list[slice]:
    """Pieces in runs of some thousand; those of one square are in one of them."""
    step = _PIECES_AT_ONCE - _MOST_IN_SQUARE
    ends = np.arange(step, len(square), step)
    ends = np.searchsorted(square, square[ends]) if len(ends) else ends
    ends = np.unique(np.concatenate([[0], ends, [len(square)]]))
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]


@jit
def _centroids(points: UInt[Array, " p"]) -> tuple[Float[Array, "p 2"], Float[Array, " p"]]:
    """Offset of the mean of each piece's points from the sample's centre, and their share of all."""
    number = jax.lax.population_count(points).astype(jnp.float32)
    # Point by point: each step is one long loop over pieces.
    sums = [jnp.zeros(points.shape, dtype=jnp.float32)] * 2
    for bit, offset in enumerate(OFFSETS):
        there = (points >> bit & 1).astype(jnp.float32)
        sums = [total + float(part) * there for total, part in zip(sums, offset, strict=True)]
    return jnp.stack(sums, axis=1) / jnp.maximum(number, 1.0)[:, None], number / POINTS
