"""From stamps to fragments: every sample of the grid that a triangle covers, with its disparity."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax._parallel import in_parallel, parts
from focusjax.layers._blocks import pad_rows
from focusjax.layers._grid import Grid
from focusjax.layers._stamps import SIZES, Stamps

_SAMPLES_AT_ONCE = 1 << 18
_STAMPS_AT_ONCE = 1 << 14
"""Of the samples and stamps tested by one call, so that compilation depends on the stamp size alone."""

_TOLERANCE = 1e-5
"""Samples by which a triangle is fattened, so that rounding opens no crack between neighbours."""


@dataclasses.dataclass(frozen=True)
class Fragments:
    """Covered samples, in no particular order.

    Attributes:
        sample: row-major index [f] of the grid sample.
        disparity: 1/m [f].
        stamp: index [f] of the stamp it came from.
    """

    sample: np.ndarray
    disparity: np.ndarray
    stamp: np.ndarray

    def take(self, index: np.ndarray) -> "Fragments":
        """The fragments at the positions `index`."""
        return Fragments(self.sample[index], self.disparity[index], self.stamp[index])


@functools.partial(jax.jit, static_argnames="size")
def _cover(
    edges: Float[Array, "n 3 3"],
    disparity: Float[Array, "n 3"],
    bounds: Float[Array, "n 2"],
    reach: Float[Array, ""],
    *,
    size: int,
) -> tuple[Bool[Array, "n samples"], Float[Array, "n samples"]]:
    """Which samples of each stamp a triangle covers within `reach` in x and y, and the disparity there."""
    step = jnp.arange(size, dtype=edges.dtype)
    x, y = jnp.tile(step, size)[None, :], jnp.repeat(step, size)[None, :]
    inside = jnp.ones((edges.shape[0], size * size), dtype=bool)
    w = jnp.zeros((edges.shape[0], size * size), dtype=edges.dtype)
    for i in range(3):
        distance = edges[:, i, 0, None] * x + edges[:, i, 1, None] * y + edges[:, i, 2, None]
        inside &= distance + reach * jnp.abs(edges[:, i, :2]).sum(axis=1, keepdims=True) >= -_TOLERANCE
        w += distance * disparity[:, i, None]
    # Fattening may step outside a sliver; its disparity must stay between those of its corners.
    return inside, jnp.clip(w, bounds[:, :1], bounds[:, 1:])


def rasterise(
    stamps: Stamps, grid: Grid, *, reach: float = 0.0, wanted: Bool[np.ndarray, " samples"] | None = None
) -> Fragments:
    """All fragments of `stamps`, diced for the same `reach`, on `grid`, or at its `wanted` samples alone."""
    columns, rows = stamps.origin.T.copy()

    def block(work: tuple[int, slice]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        size, part = work
        inputs = [pad_rows(a[part], _at_once(size)) for a in (stamps.edges, stamps.disparity, stamps.bounds)]
        covered, disparity = (
            np.asarray(a)[: part.stop - part.start] for a in _cover(*inputs, np.float32(reach), size=size)
        )
        flat = np.flatnonzero(covered)
        stamp, offset = np.divmod(flat.astype(np.int32), np.int32(size * size))
        stamp += part.start
        row, column = np.divmod(offset, np.int32(size))
        column += np.take(columns, stamp)
        row += np.take(rows, stamp)
        values = np.take(disparity, flat)
        if size > 1:
            on_grid = np.flatnonzero((column < grid.columns) & (row < grid.rows))
            column, row, values, stamp = column[on_grid], row[on_grid], values[on_grid], stamp[on_grid]
        sample = row * np.int32(grid.columns) + column
        if wanted is not None:
            kept = np.flatnonzero(np.take(wanted, sample))
            sample, values, stamp = sample[kept], values[kept], stamp[kept]
        return sample, values, stamp

    work, start = [], 0
    for size, count in zip(SIZES, stamps.counts, strict=True):
        for part in parts(count, _at_once(size)):
            work.append((size, slice(start + part.start, start + part.stop)))
        start += count
    empty = (np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.int32))
    return Fragments(*(np.concatenate(a) for a in zip(empty, *in_parallel(block, work), strict=True)))


def _at_once(size: int) -> int:
    return min(_SAMPLES_AT_ONCE // size**2, _STAMPS_AT_ONCE)
