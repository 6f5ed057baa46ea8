"""The parts of a sample's square that lie in different triangles of its surface.

Each square is looked at in 32 points. Part k is where triangle k is the nearest of those that belong to the
square's surface; its share of the square is that of the points in it, and its place is their centroid.
"""

import dataclasses
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._parallel import in_parallel
from focusjax.layers._attributes import SurfaceSamples, surface_samples
from focusjax.layers._blocks import in_blocks
from focusjax.layers._boxes import Boxes, boxes_on
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid
from focusjax.layers._raster import Fragments, rasterise
from focusjax.layers._silhouettes import _OFFSETS, _POINTS, _inside, _touching
from focusjax.layers._stamps import Stamps, dice

_AT_ONCE = 1 << 16
_NO_BOXES = np.zeros(0, dtype=np.intp), *[np.zeros((0, 2), dtype=np.int32)] * 2


@dataclasses.dataclass(frozen=True)
class Squares:
    """Squares of samples, each with the surface that is meant there.

    Attributes:
        cell: grid sample [n], row-major; several may have the same.
        low: least disparity [n] of the surface there.
        high: largest disparity [n].
        clear: whether [n] the surface may be seen through; None where none may.
    """

    cell: np.ndarray
    low: np.ndarray
    high: np.ndarray
    clear: np.ndarray | None

    def take(self, index: Int[np.ndarray, " k"]) -> "Squares":
        """The squares at the positions `index`."""
        clear = None if self.clear is None else self.clear[index]
        return Squares(self.cell[index], self.low[index], self.high[index], clear)


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


def inside_one(stamps: Stamps, fragments: Fragments, grid: Grid) -> Bool[np.ndarray, " f"]:
    """Whether the square around each fragment lies inside its triangle."""
    return in_blocks(_inside_one, _in_stamps(stamps, fragments.stamp, fragments.sample, grid), _AT_ONCE)


@jax.jit
def _inside_one(edges: Float[Array, "n 3 3"], place: Float[Array, "n 2"]) -> Bool[Array, " n"]:
    at_place = edges[:, :, 0] * place[:, :1] + edges[:, :, 1] * place[:, 1:] + edges[:, :, 2]
    return (at_place >= 0.5 * jnp.abs(edges[:, :, :2]).sum(axis=2)).all(axis=1)


def _in_stamps(
    stamps: Stamps, stamp: np.ndarray, sample: np.ndarray, grid: Grid
) -> tuple[np.ndarray, np.ndarray]:
    """Edge functions [n, 3, 3] of stamps, and where in them [n, 2] the grid's samples lie."""
    row, column = np.divmod(sample, np.int32(grid.columns))
    place = np.stack([column, row], axis=1) - np.take(stamps.origin, stamp, axis=0)
    return np.take(stamps.edges, stamp, axis=0), place.astype(np.float32)


def square_parts(
    triangles: ScreenTriangles, grid: Grid, squares: Squares, clear: Bool[np.ndarray, " t"] | None
) -> Parts:
    """The parts of `squares`. Those in which no triangle of their surface covers a point have none.

    `clear` says which of the scene's faces may be seen through; None if none may.
    """
    at = _Lookup(grid, squares)
    wanted = at.count > 0
    near = triangles.take(_touching(triangles, grid, wanted))

    def some(boxes: Boxes) -> tuple[np.ndarray, ...]:
        """The square, the points and the disparity of each piece, its grid sample, and its stamp."""
        stamps = dice(near, [boxes], reach=0.5)
        fragments = rasterise(stamps, grid, reach=0.5, wanted=wanted)
        which, square = at.surfaces_of(fragments)
        fragments = fragments.take(which)
        triangle = np.take(stamps.triangle, fragments.stamp)
        edges, place = _in_stamps(stamps, fragments.stamp, fragments.sample, grid)
        points, plane = in_blocks(_pieces, (edges, stamps.disparity[fragments.stamp], place), _AT_ONCE)
        there = points > 0
        if clear is not None and squares.clear is not None:
            there &= clear[near.source[triangle]] == squares.clear[square]
        there = np.flatnonzero(there)
        kept = fragments.take(there)
        stamp = (a[kept.stamp] for a in (stamps.origin, stamps.edges, stamps.disparity, stamps.bounds))
        return square[there], points[there], plane[there], kept.sample, *stamp, triangle[there]

    found = in_parallel(some, boxes_on(grid, near, reach=0.5)) or [some(Boxes(*_NO_BOXES))]
    square, points, plane, sample, *stamp = (np.concatenate(a) for a in zip(*found, strict=True))
    order = np.argsort(square, kind="stable")
    points = _where_nearest(points[order], plane[order], square[order])
    seen = np.flatnonzero(points)
    order = order[seen]
    place, share = in_blocks(_centroids, (points[seen],), _AT_ONCE)
    own = Stamps((), *(a[order] for a in stamp))
    each = np.arange(len(order), dtype=np.int32)
    surface = surface_samples(own, near, sample[order], each, grid, place)
    return Parts(square[order], share, surface)


class _Lookup:
    """Which squares there are at each sample of the grid.

    Attributes:
        count: how many [samples].
    """

    def __init__(self, grid: Grid, squares: Squares):
        self._order = np.argsort(squares.cell, kind="stable").astype(np.int32)
        self._low, self._high = (a[self._order].astype(np.float32) for a in (squares.low, squares.high))
        self.count = np.bincount(squares.cell, minlength=grid.size).astype(np.int32)
        self._first = np.cumsum(self.count, dtype=np.int32) - self.count

    def surfaces_of(self, fragments: Fragments) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
        """Fragments, and the squares to whose surface each belongs."""
        which = np.arange(len(fragments.sample), dtype=np.int32)
        count, first = (np.take(a, fragments.sample) for a in (self.count, self._first))
        disparity, found = fragments.disparity, [(which[:0], which[:0])]
        for rank in range(int(count.max(initial=0))):
            left = np.flatnonzero(count > rank)
            which, count, first, disparity = (np.take(a, left) for a in (which, count, first, disparity))
            place = first + np.int32(rank)
            same = (disparity >= np.take(self._low, place)) & (disparity <= np.take(self._high, place))
            same = np.flatnonzero(same)
            found.append((np.take(which, same), np.take(place, same)))
        which, place = (np.concatenate(column) for column in zip(*found, strict=True))
        return which, np.take(self._order, place)


@jax.jit
def _pieces(
    edges: Float[Array, "p 3 3"], disparity: Float[Array, "p 3"], place: Float[Array, "p 2"]
) -> tuple[UInt[Array, " p"], Float[Array, "p 3"]]:
    """Points around each `place` inside a triangle, a bit each; its disparity there, its change in x, y."""
    across, down, offset = ((edges[:, :, k] * disparity).sum(axis=1) for k in range(3))
    plane = jnp.stack([across * place[:, 0] + down * place[:, 1] + offset, across, down], axis=1)
    return _inside(edges, place)[0], plane


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
    nearest = np.zeros((len(start), _POINTS), dtype=np.float32)
    owner = np.full((len(start), _POINTS), -1, dtype=np.int32)
    for rank, left in _ranks(length):
        piece = start[left] + rank
        w = plane[piece, :1] + plane[piece, 1:] @ _OFFSETS.T.astype(np.float32)
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
    there = ((points[:, None] >> jnp.arange(_POINTS, dtype=jnp.uint32)[None]) & 1).astype(real)
    number = there.sum(axis=1)
    offsets = jnp.asarray(_OFFSETS, dtype=real)
    sums = jnp.stack([(there * offsets[None, :, k]).sum(axis=1) for k in (0, 1)], axis=1)
    return sums / jnp.maximum(number, 1.0)[:, None], number / _POINTS
