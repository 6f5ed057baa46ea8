"""From stamps to fragments: every sample of the grid that a triangle covers, with its disparity."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._parallel import in_parallel, parts
from focusjax._programs import jit
from focusjax.layers._blocks import pad_rows
from focusjax.layers._clip import TOLERANCE, Edges, ScreenTriangles, edge_functions
from focusjax.layers._grid import Grid
from focusjax.layers._stamps import SIZES, Stamps

_SAMPLES_AT_ONCE = 1 << 18
_STAMPS_AT_ONCE = 1 << 15
"""Of the samples and stamps tested by one call, so that compilation depends on the stamp size alone."""


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

    Args:
        edges: the functions of each stamp's triangle; None to work them out.
        corners: x, y and disparity of its corners, counted from the stamp's first sample.
        first: that sample's column and row.
        limits: columns and rows of the grid.
        size: edge of a stamp in samples.
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
