"""The parts of a sample's square that lie in different triangles of its surface.

Each square is looked at in 32 points. Part k is where triangle k is the nearest of those that belong to the
square's surface; its share of the square is that of the points in it, and its place is their centroid.
"""

import dataclasses
import itertools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._parallel import in_parallel, parts
from focusjax.layers._attributes import SurfaceSamples, surface_samples
from focusjax.layers._blocks import in_blocks
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._edges import edge_functions
from focusjax.layers._grid import Grid
from focusjax.layers._raster import Fragments
from focusjax.layers._silhouettes import OFFSETS, POINTS, points_inside
from focusjax.layers._touching import touching

_AT_ONCE = 1 << 16
_FIRST = np.float32(1.0 + 1e-6)
"""By which a square's own triangle is nearer than others in the same place."""


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

    def take(self, index: Int[np.ndarray, " k"]) -> "Squares":
        """The squares at the positions `index`."""
        clear = None if self.clear is None else self.clear[index]
        columns = (a[index] for a in (self.cell, self.low, self.high, self.triangle))
        return Squares(*columns, clear)


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


def inside_one(triangles: ScreenTriangles, fragments: Fragments, grid: Grid) -> Bool[np.ndarray, " f"]:
    """Whether the square around each fragment lies inside its triangle."""

    def block(part: slice) -> Bool[np.ndarray, " k"]:
        row, column = np.divmod(fragments.sample[part], np.int32(grid.columns))
        edges = edge_functions(*triangles.around(fragments.triangle[part], column, row), np)
        inside = np.ones(len(row), dtype=bool)
        for across, down, offset, _ in edges:
            inside &= offset >= 0.5 * (np.abs(across) + np.abs(down))
        return inside

    found = in_parallel(block, parts(len(fragments.sample), _AT_ONCE))
    return np.concatenate([np.zeros(0, dtype=bool), *found])


def square_parts(
    triangles: ScreenTriangles, grid: Grid, squares: Squares, clear: Bool[np.ndarray, " t"] | None
) -> Parts:
    """The parts of `squares`. Those in which no triangle of their surface covers a point have none.

    `clear` says which of the scene's faces may be seen through; None if none may.
    """
    order = np.argsort(squares.cell, kind="stable")
    found = touching(triangles, grid, squares.cell[order], squares.low[order], squares.high[order])
    square = order[found.square]
    points = in_blocks(points_inside, found.sides, _AT_ONCE)[0]
    there = points > 0
    if clear is not None and squares.clear is not None:
        there &= clear[triangles.source[found.triangle]] == squares.clear[square]
    there = np.flatnonzero(there)
    there = there[np.argsort(square[there], kind="stable")]
    square, plane = square[there], np.stack([values[there] for values in found.plane], axis=1)
    points = points[there]
    plane[found.triangle[there] == squares.triangle[square]] *= _FIRST

    def nearest(part: slice) -> None:
        points[part] = _where_nearest(points[part], plane[part], square[part])

    in_parallel(nearest, _whole_squares(square))
    seen = np.flatnonzero(points)
    square, triangle = square[seen], found.triangle[there[seen]]
    place, share = in_blocks(_centroids, (points[seen],), _AT_ONCE)
    surface = surface_samples(triangles, squares.cell[square].astype(np.int32), triangle, grid, place)
    return Parts(square, share, surface)


def _whole_squares(square: Int[np.ndarray, " p"]) -> list[slice]:
    """Pieces in runs of some thousand; those of one square are in one of them."""
    ends = np.arange(_AT_ONCE, len(square), _AT_ONCE)
    ends = np.searchsorted(square, square[ends]) if len(ends) else ends
    ends = np.unique(np.concatenate([[0], ends, [len(square)]]))
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def _where_nearest(
    points: UInt[np.ndarray, " p"], plane: Float[np.ndarray, "p 3"], square: Int[np.ndarray, " p"]
) -> UInt[np.ndarray, " p"]:
    """Points of each piece where its `plane` is the nearest of its square; the pieces of one are in a row."""
    points = points.copy()
    start = np.flatnonzero(np.diff(square, prepend=-1))
    length = np.diff(start, append=len(square))
    several = length > 1
    start, length = start[several], length[several]
    together = points[start]
    overlap = np.zeros(len(start), dtype=bool)
    for rank, left in _ranks(length, first=1):
        own = points[start[left] + rank]
        overlap[left] |= (together[left] & own) > 0
        together[left] |= own
    start, length = start[overlap], length[overlap]
    nearest = np.zeros((len(start), POINTS), dtype=np.float32)
    owner = np.full((len(start), POINTS), -1, dtype=np.int32)
    for rank, left in _ranks(length):
        piece = start[left] + rank
        w = plane[piece, :1] + plane[piece, 1:] @ OFFSETS.T.astype(np.float32)
        nearer = (w > nearest[left]) & _unpacked(points[piece])
        nearest[left] = np.where(nearer, w, nearest[left])
        owner[left] = np.where(nearer, rank, owner[left])
    for rank, left in _ranks(length):
        bits = np.packbits(owner[left] == rank, axis=1, bitorder="little")
        points[start[left] + rank] = np.ascontiguousarray(bits).view(np.uint32)[:, 0]
    return points


def _ranks(length: Int[np.ndarray, " s"], first: int = 0) -> Iterator[tuple[int, Int[np.ndarray, " k"]]]:
    """Numbers from `first` on, and which of the lengths are above each."""
    left = np.arange(len(length))
    for rank in range(first, int(length.max(initial=0))):
        left = left[length[left] > rank]
        yield rank, left


def _unpacked(points: UInt[np.ndarray, " n"]) -> Bool[np.ndarray, "n 32"]:
    """Whether each point is among those of a mask."""
    return np.unpackbits(
        np.ascontiguousarray(points)[:, None].view(np.uint8), axis=1, bitorder="little"
    ).astype(bool)


@jax.jit
def _centroids(points: UInt[Array, " p"]) -> tuple[Float[Array, "p 2"], Float[Array, " p"]]:
    """Offset of the mean of each piece's points from the sample's centre, and their share of all."""
    real = jnp.float32
    there = ((points[:, None] >> jnp.arange(POINTS, dtype=jnp.uint32)[None]) & 1).astype(real)
    number = there.sum(axis=1)
    offsets = jnp.asarray(OFFSETS, dtype=real)
    sums = jnp.stack([(there * offsets[None, :, k]).sum(axis=1) for k in (0, 1)], axis=1)
    return sums / jnp.maximum(number, 1.0)[:, None], number / POINTS
