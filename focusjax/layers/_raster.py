"""The rasteriser: triangles are cut into square stamps, stamps into covered samples with their disparity."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._parallel import in_parallel, parts
from focusjax._programs import jit
from focusjax.layers._blocks import pad_rows
from focusjax.layers._boxes import Boxes
from focusjax.layers._clip import TOLERANCE, Edges, ScreenTriangles, edge_functions
from focusjax.layers._grid import Grid

SIZES = (1, 2, 4, 8, 16)
"""Edge lengths of stamps in samples; a larger triangle is diced into several of the last size."""

_DICED_AT_ONCE = 1 << 25
"""In the boxes that one call dices, of which one may be larger: a hundred thousand of the largest stamps."""
_SAMPLES_AT_ONCE = 1 << 18
_STAMPS_AT_ONCE = 1 << 15
"""Of the samples and stamps tested by one call, so that compilation depends on the stamp size alone."""


@dataclasses.dataclass(frozen=True)
class Stamps:
    """Stamps, ordered by size.

    Attributes:
        counts: number of stamps of each of `SIZES`.
        triangle: index [n] into the screen triangles.
        column: of the first sample [n].
        row: of the first sample [n].
    """

    counts: tuple[int, ...]
    triangle: np.ndarray
    column: np.ndarray
    row: np.ndarray


def dice(triangles: ScreenTriangles, boxes: Sequence[Boxes]) -> Stamps:
    """All stamps that may hold a sample of `boxes` whose centre its triangle covers."""

    def some(part: Boxes) -> list[tuple[np.ndarray, ...]]:
        size = _stamp_size(part)
        chosen = ((each, part.take(np.flatnonzero(size == each))) for each in SIZES)
        return [_stamps_of_size(each, triangles, boxes) for each, boxes in chosen]

    # Large triangles are looked at in many stamps before those that they miss are left out.
    work = [less for part in boxes for less in part.portions(part.samples, _DICED_AT_ONCE)]
    # An empty part gives the arrays their types where there are no triangles at all.
    found = in_parallel(some, work) or [some(Boxes(*[np.zeros(0, dtype=np.int32)] * 5))]
    by_size = list(zip(*found, strict=True))
    counts = tuple(sum(len(stamps[0]) for stamps in of_size) for of_size in by_size)
    fields = zip(*(stamps for of_size in by_size for stamps in of_size), strict=True)
    return Stamps(counts, *(np.concatenate(field) for field in fields))


def _tiles(size: int, boxes: Boxes) -> tuple[np.ndarray, np.ndarray]:
    """How many stamps lie side by side in each box, and how many one below the other."""
    shift = size.bit_length() - 1
    return (boxes.width + (size - 1)) >> shift, (boxes.height + (size - 1)) >> shift


def _stamp_size(boxes: Boxes) -> np.ndarray:
    """Smallest stamp of which one covers each box, or up to four if it is larger than two samples."""
    extent = (boxes.width - 1) | (boxes.height - 1)
    size = np.where(extent <= 1, extent + 1, SIZES[-1])
    larger = np.flatnonzero(extent > 1)
    some = boxes.take(larger)
    for each in SIZES[-2:1:-1]:
        across, down = _tiles(each, some)
        size[larger[across * down <= 4]] = each
    return size


def _stamps_of_size(
    size: int, triangles: ScreenTriangles, boxes: Boxes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The arrays of `Stamps`, from `triangle` on, for boxes of one stamp size."""
    triangle, column, row = boxes.triangle, boxes.column, boxes.row
    if size <= 2:
        return triangle, column, row
    across, down = _tiles(size, boxes)
    count = across * down
    owner = np.repeat(np.arange(len(triangle), dtype=np.int32), count)
    tile = np.arange(len(owner), dtype=np.int32) - np.repeat(np.cumsum(count) - count, count)
    tile_row = tile // across[owner]
    right, below = size * (tile - tile_row * across[owner]), size * tile_row
    if size == SIZES[-1]:
        # A stamp wholly outside one side holds nothing: keep those whose best corner is inside all.
        kept = np.ones(len(owner), dtype=bool)
        for x, y, offset, _ in edge_functions(*triangles.around(triangle, column, row), np):
            best = offset + (size - 1) * (np.maximum(x, 0) + np.maximum(y, 0))
            kept &= x[owner] * right + y[owner] * below + best[owner] >= -1e-4
        owner, right, below = (np.compress(kept, a) for a in (owner, right, below))
    return triangle[owner], column[owner] + right.astype(np.int32), row[owner] + below.astype(np.int32)


@dataclasses.dataclass(frozen=True)
class Fragments:
    """Covered samples, in no particular order.

    Attributes:
        sample: row-major index [f] of the grid sample.
        disparity: 1/m [f].
        triangle: index [f] of the screen triangle that covers it.
    """

    sample: np.ndarray
    disparity: np.ndarray
    triangle: np.ndarray

    def take(self, index: np.ndarray) -> "Fragments":
        """The fragments at the positions `index`."""
        return Fragments(*(np.take(a, index) for a in (self.sample, self.disparity, self.triangle)))


@jit
def _cover(
    edges: Edges | None,
    corners: tuple[tuple[Float[Array, " n"], ...], ...],
    first: tuple[Int[Array, " n"], Int[Array, " n"]],
    limits: tuple[Int[Array, ""], Int[Array, ""]],
    *,
    size: int,
) -> tuple[Bool[Array, "n samples"], Float[Array, "n samples"], Int[Array, "n samples"]]:
    """Which samples of each stamp a triangle covers, the disparity there, and the place.

    `edges` are the functions of each stamp's triangle, None to work them out; `corners` are x, y and
    disparity of its corners, counted from the stamp's `first` sample, given by column and row. `limits` are
    the columns and rows of the grid, and `size` is the edge of a stamp in samples.
    """
    x, y, (w0, w1, w2) = corners
    sides = edge_functions(x, y, (w0, w1, w2), jnp) if edges is None else edges
    step = jnp.arange(size, dtype=jnp.int32)
    right, below = jnp.tile(step, size)[None, :], jnp.repeat(step, size)[None, :]
    x, y = right.astype(w0.dtype), below.astype(w0.dtype)
    column, row = first[0][:, None] + right, first[1][:, None] + below
    inside = (column < limits[0]) & (row < limits[1])
    w = jnp.zeros(inside.shape, dtype=w0.dtype)
    for across, down, offset, scale in sides:
        distance = across[:, None] * x + down[:, None] * y + offset[:, None]
        inside &= distance >= -TOLERANCE
        w += distance * scale[:, None]
    # Fattening may step outside a sliver; its disparity must stay between those of its corners.
    least, most = (op(op(w0, w1), w2)[:, None] for op in (jnp.minimum, jnp.maximum))
    return inside, jnp.clip(w, least, most), row * limits[0] + column


def rasterise(triangles: ScreenTriangles, stamps: Stamps, grid: Grid) -> Fragments:
    """All fragments of `stamps` on `grid`."""
    limits = np.int32(grid.columns), np.int32(grid.rows)

    def block(work: tuple[int, slice]) -> tuple[np.ndarray, ...]:
        size, part = work
        triangle, *first = (
            pad_rows(a[part], _at_once(size)) for a in (stamps.triangle, stamps.column, stamps.row)
        )
        corners = triangles.around(triangle, *first)
        edges = _single(edge_functions(*corners, np)) if size == SIZES[-1] else None
        arrays: Any = edges, _single(corners), tuple(first), limits
        covered, disparity, sample = (
            np.asarray(a)[: part.stop - part.start] for a in _cover(*arrays, size=size)
        )
        flat = np.flatnonzero(covered)
        return np.take(sample, flat), np.take(disparity, flat), np.take(triangle, flat // size**2)

    work, start = [], 0
    for size, count in zip(SIZES, stamps.counts, strict=True):
        for part in parts(count, _at_once(size)):
            work.append((size, slice(start + part.start, start + part.stop)))
        start += count
    empty = np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.int32)
    return Fragments(*(np.concatenate(a) for a in zip(empty, *in_parallel(block, work), strict=True)))


def _single(numbers: tuple[tuple[np.ndarray, ...], ...]) -> tuple[tuple[np.ndarray, ...], ...]:
    """The same in single precision."""
    return tuple(tuple(a.astype(np.float32) for a in some) for some in numbers)


def _at_once(size: int) -> int:
    return min(_SAMPLES_AT_ONCE // size**2, _STAMPS_AT_ONCE)
