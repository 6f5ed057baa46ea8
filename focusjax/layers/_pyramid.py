"""N-buffers: least and largest disparity over any square in four look-ups (Decoret 2005, Lee10 3.1).

Level i answers squares of 2^i x 2^i blocks. Up to level 2 there is an answer for a square at every block.
Higher levels are made of a base coarsened by s = 2^(i - 2), as Lee10 suggests: an answer for every s-th
block, over 5 s blocks, so that it holds wherever between two of them the square begins. They are then at
most a quarter wider than they need to be, and together take a ninth of the memory of the fine ones.
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

_FINE_LEVELS = 3
_COARSE_WIDTH = (1 << (_FINE_LEVELS - 1)) + 1
"""Coarsened blocks over which an answer of a coarse level holds."""


class RangePyramid(eqx.Module):
    """Extremes of disparity over squares, all layers together.

    Blocks are squares of `block` samples, so that the pyramid costs the memory of few pictures whatever
    the supersampling.

    Attributes:
        least: least disparity [n] of the answers of all levels, one after the other; infinite where
            nothing is.
        largest: largest disparity [n]; 0 where nothing is.
        deepest: largest number of layers [n].
        overall: least and largest disparity of all [2].
        most_layers: largest number of layers anywhere.
        block: edge of a block in samples (static).
        shapes: rows and columns of each level's answers (static).
    """

    least: Float[Array, " n"]
    largest: Float[Array, " n"]
    deepest: UInt8[Array, " n"]
    overall: Float[Array, "2"]
    most_layers: Int[Array, ""]
    block: int = eqx.field(static=True)
    shapes: tuple[tuple[int, int], ...] = eqx.field(static=True)

    def query(
        self, low: Float[Array, "2"], high: Float[Array, "2"]
    ) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
        """Least and largest disparity and layer count between the corners `low` and `high` (samples).

        The answer bounds the true one, as the box is rounded outwards to blocks. A box larger than the
        top level's square is answered for the whole grid.
        """
        rows, columns = self.shapes[0]
        limit = jnp.array([columns - 1, rows - 1], dtype=jnp.int32)
        first = jnp.clip(jnp.floor(low / self.block).astype(jnp.int32), 0, limit)
        last = jnp.clip(jnp.floor(high / self.block).astype(jnp.int32), 0, limit)
        span = jnp.max(last - first + 1)
        level = jnp.minimum(31 - jax.lax.clz(span), len(self.shapes) - 1)
        second = jnp.maximum(last + 1 - (1 << level), first)
        start = np.cumsum([0, *(r * c for r, c in self.shapes[:-1])])
        offset, width = (jnp.asarray(a, dtype=jnp.int32)[level] for a in (start, [c for _, c in self.shapes]))
        coarse = jnp.maximum(level - (_FINE_LEVELS - 1), 0)
        places = (first >> coarse, second >> coarse)
        index = jnp.stack([offset + b[1] * width + a[0] for a in places for b in places])
        fits = span <= 2 << level
        return (
            jnp.where(fits, self.least[index].min(), self.overall[0]),
            jnp.where(fits, self.largest[index].max(), self.overall[1]),
            jnp.where(fits, self.deepest[index].max().astype(jnp.int32), self.most_layers),
        )


def build_ranges(
    cell: Int[np.ndarray, " n"],
    low: Float[np.ndarray, " n"],
    high: Float[np.ndarray, " n"],
    *,
    shape: tuple[int, int],
    block: int,
    widest: float,
) -> RangePyramid:
    """The pyramid over all layers together, for squares up to `widest` samples across.

    `low` and `high` are the disparities spanned by the samples at `cell`, row-major on a grid of `shape`.
    """
    size = shape[0] * shape[1]
    least = np.full(size, np.inf, dtype=low.dtype)
    largest = np.zeros(size, dtype=high.dtype)
    np.minimum.at(least, cell, low)
    np.maximum.at(largest, cell, high)
    deepest = np.minimum(np.bincount(cell, minlength=size), 255).astype(np.uint8)
    levels = max(1, int(widest / block + 2).bit_length())
    tables = []
    for base, fill, op in (
        (least, np.inf, np.minimum),
        (largest, 0, np.maximum),
        (deepest, 0, np.maximum),
    ):
        tables.append(_levels(_coarser(base.reshape(shape), block, fill, op), levels, fill, op))
    flat = (jnp.asarray(np.concatenate([level.ravel() for level in table])) for table in tables)
    overall = np.array([least.min(initial=np.inf), largest.max(initial=0)], dtype=low.dtype)
    return RangePyramid(
        *flat,
        overall=jnp.asarray(overall),
        most_layers=jnp.asarray(int(deepest.max(initial=0)), dtype=jnp.int32),
        block=block,
        shapes=tuple(level.shape for level in tables[0]),
    )


def _levels(base: np.ndarray, count: int, fill: float, op: Callable[..., np.ndarray]) -> list[np.ndarray]:
    """The answers of `count` levels over blocks with the values `base`."""
    levels = [base]
    while len(levels) < min(count, _FINE_LEVELS):
        reach = 1 << (len(levels) - 1)
        levels.append(_widened(levels[-1], (0, reach), fill, op))
    while len(levels) < count:
        base = _coarser(base, 2, fill, op)
        levels.append(_widened(base, range(_COARSE_WIDTH), fill, op))
    return levels


def _widened(
    table: np.ndarray, shifts: tuple[int, ...] | range, fill: float, op: Callable[..., np.ndarray]
) -> np.ndarray:
    """`op` over the places `shifts` to the right and below, all combinations."""
    for axis in (0, 1):
        padding = [(0, max(shifts) if k == axis else 0) for k in (0, 1)]
        padded = np.pad(table, padding, constant_values=fill)
        length = table.shape[axis]
        table = functools.reduce(
            op, (padded[s : s + length] if axis == 0 else padded[:, s : s + length] for s in shifts)
        )
    return table


def _coarser(a: np.ndarray, block: int, fill: float, op: Callable[..., np.ndarray]) -> np.ndarray:
    """`op` over squares of `block` x `block`."""
    rows, columns = a.shape
    padded = np.pad(a, ((0, -rows % block), (0, -columns % block)), constant_values=fill)
    across = functools.reduce(op, (padded[:, k::block] for k in range(block)))
    return functools.reduce(op, (across[k::block] for k in range(block)))
