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
from jaxtyping import Array, Float, Int, UInt

from focusjax._device import device_array

_FINE_LEVELS = 3
_COARSE_WIDTH = (1 << (_FINE_LEVELS - 1)) + 1
"""Coarsened blocks over which an answer of a coarse level holds."""
_NOTHING = (1 << 13) - 1
"""Least disparity where nothing is, beyond all steps."""
_MOST_DEEP = 63


class RangePyramid(eqx.Module):
    """Extremes of disparity over squares, all layers together.

    Blocks are squares of `block` samples, so that the pyramid costs the memory of few pictures whatever
    the supersampling. Disparities are in the steps of the layers' own intervals.

    Attributes:
        answers: words [n] of all levels, one after the other. From the highest bit down: 13 bits of the least
            disparity (all ones where nothing is), 13 of the largest (0 where nothing is), 6 of the largest
            number of layers (63 stands for as many as there are anywhere).
        scale: dioptres per step.
        overall: least and largest disparity of all [2], in 1/m; infinity and 0 where nothing is.
        most_layers: largest number of layers anywhere.
        block: edge of a block in samples (static).
        shapes: rows and columns of each level's answers (static).
    """

    answers: UInt[Array, " n"]
    scale: Float[Array, ""]
    overall: Float[Array, "2"]
    most_layers: Int[Array, ""]
    block: int = eqx.field(static=True)
    shapes: tuple[tuple[int, int], ...] = eqx.field(static=True)

    def query(
        self, low: Float[Array, "2"], high: Float[Array, "2"]
    ) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
        """Least and largest disparity and layer count between the corners `low` and `high` (samples).

        The answer bounds the true one, as the box is rounded outwards to blocks. A box larger than the
        top level's square is answered for the whole grid. The largest is 0 where nothing is.
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
        words = self.answers[jnp.stack([offset + b[1] * width + a[0] for a in places for b in places])]
        least, largest = ((steps.astype(self.scale.dtype) * self.scale) for steps in _extremes(words))
        deepest = (words & _MOST_DEEP).max().astype(jnp.int32)
        fits = span <= 2 << level
        return (
            jnp.where(fits, least, self.overall[0]),
            jnp.where(fits, largest, self.overall[1]),
            jnp.where(fits & (deepest < _MOST_DEEP), deepest, self.most_layers),
        )


def _extremes(words: UInt[Array, " n"]) -> tuple[UInt[Array, ""], UInt[Array, ""]]:
    """Least and largest disparity of some answers, in steps."""
    return (words >> 19).min(), (words >> 6 & _NOTHING).max()


def build_ranges(
    cell: Int[np.ndarray, " n"],
    least: UInt[np.ndarray, " n"],
    most: UInt[np.ndarray, " n"],
    scale: float,
    *,
    shape: tuple[int, int],
    block: int,
    widest: float,
    real: np.dtype,
) -> RangePyramid:
    """The pyramid over all layers together, for squares up to `widest` samples across.

    Samples are at row-major places `cell` on a grid of `shape`, rows and columns, and span disparities from
    `least` to `most` in steps of `scale` dioptres (see `in_steps`); answers are of the type `real`.
    """
    size = shape[0] * shape[1]
    lowest = np.full(size, _NOTHING, dtype=np.uint16)
    highest = np.zeros(size, dtype=np.uint16)
    np.minimum.at(lowest, cell, least.astype(np.uint16))
    np.maximum.at(highest, cell, most.astype(np.uint16))
    deepest = np.bincount(cell, minlength=size)
    most_layers = int(deepest.max(initial=0))
    deepest = np.minimum(deepest, _MOST_DEEP).astype(np.uint8)
    levels = max(1, int(widest / block + 2).bit_length())
    tables = []
    for base, fill, op in (
        (lowest, _NOTHING, np.minimum),
        (highest, 0, np.maximum),
        (deepest, 0, np.maximum),
    ):
        tables.append(_levels(_coarser(base.reshape(shape), block, fill, op), levels, fill, op))
    answers = [
        (low.astype(np.uint32) << 19 | high.astype(np.uint32) << 6 | deep).ravel()
        for low, high, deep in zip(*tables, strict=True)
    ]
    overall = (least.min() * scale, most.max() * scale) if len(cell) else (np.inf, 0.0)
    return RangePyramid(
        answers=device_array(np.concatenate(answers)),
        scale=device_array(scale, dtype=real),
        overall=device_array(overall, dtype=real),
        most_layers=device_array(most_layers, dtype=jnp.int32),
        block=block,
        shapes=tuple(level.shape for level in tables[0]),
    )


def _levels(base: np.ndarray, count: int, fill: int, op: Callable[..., np.ndarray]) -> list[np.ndarray]:
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
    table: np.ndarray, shifts: tuple[int, ...] | range, fill: int, op: Callable[..., np.ndarray]
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


def _coarser(a: np.ndarray, block: int, fill: int, op: Callable[..., np.ndarray]) -> np.ndarray:
    """`op` over squares of `block` x `block`."""
    rows, columns = a.shape
    padded = np.pad(a, ((0, -rows % block), (0, -columns % block)), constant_values=fill)
    across = functools.reduce(op, (padded[:, k::block] for k in range(block)))
    return functools.reduce(op, (across[k::block] for k in range(block)))
