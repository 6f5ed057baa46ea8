"""N-buffers: least and largest disparity over any square in four look-ups (Decoret 2005, Lee10 3.1)."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


class RangePyramid(eqx.Module):
    """Level i holds, at each block, the extremes over the 2^i x 2^i blocks to its right and below.

    Blocks are squares of `block` samples, so that the pyramid costs the memory of one picture per
    level whatever the supersampling.

    Attributes:
        least: least disparity [level, h, w]; infinite where nothing is.
        largest: largest disparity [level, h, w]; 0 where nothing is.
        deepest: largest number of layers [level, h, w].
        overall: least and largest disparity of all [2].
        most_layers: largest number of layers anywhere.
        block: edge of a block in samples (static).
    """

    least: Float[Array, "level h w"]
    largest: Float[Array, "level h w"]
    deepest: Int[Array, "level h w"]
    overall: Float[Array, "2"]
    most_layers: Int[Array, ""]
    block: int = eqx.field(static=True)

    def query(
        self, low: Float[Array, "2"], high: Float[Array, "2"]
    ) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
        """Least and largest disparity and layer count between the corners `low` and `high` (samples).

        The answer bounds the true one, as the box is rounded outwards to blocks. A box larger than the
        top level's square is answered for the whole grid.
        """
        levels, rows, columns = self.least.shape
        limit = jnp.array([columns - 1, rows - 1], dtype=jnp.int32)
        first = jnp.clip(jnp.floor(low / self.block).astype(jnp.int32), 0, limit)
        last = jnp.clip(jnp.floor(high / self.block).astype(jnp.int32), 0, limit)
        span = jnp.max(last - first + 1)
        level = jnp.minimum(31 - jax.lax.clz(span), levels - 1)
        second = jnp.maximum(last + 1 - (1 << level), first)
        xs, ys = (first[0], second[0]), (first[1], second[1])
        index = jnp.stack([(level * rows + y) * columns + x for y in ys for x in xs])
        fits = span <= 2 << level
        return (
            jnp.where(fits, self.least.reshape(-1)[index].min(), self.overall[0]),
            jnp.where(fits, self.largest.reshape(-1)[index].max(), self.overall[1]),
            jnp.where(fits, self.deepest.reshape(-1)[index].max(), self.most_layers),
        )


def build_ranges(
    low: Float[Array, "l h w"], high: Float[Array, "l h w"], *, block: int, widest: float
) -> RangePyramid:
    """The pyramid over all layers together, for squares up to `widest` samples across.

    `low` and `high` are the disparities that each sample spans, 0 where it holds nothing.
    """
    levels = max(1, int(widest / block + 2).bit_length())
    return _build(low, high, block=block, levels=levels)


@eqx.filter_jit
def _build(
    low: Float[Array, "l h w"], high: Float[Array, "l h w"], *, block: int, levels: int
) -> RangePyramid:
    held = high > 0
    least = jnp.where(held, low, jnp.inf).min(axis=0)
    largest = high.max(axis=0)
    deepest = held.sum(axis=0, dtype=jnp.int32)
    least, largest, deepest = (
        _over_blocks(a, block, fill, op)
        for a, fill, op in (
            (least, jnp.inf, jnp.min),
            (largest, 0.0, jnp.max),
            (deepest, 0, jnp.max),
        )
    )
    reaches = 1 << jnp.arange(levels - 1)
    tables = (
        _widening(least, reaches, jnp.inf, jnp.minimum),
        _widening(largest, reaches, 0.0, jnp.maximum),
        _widening(deepest, reaches, 0, jnp.maximum),
    )
    overall = jnp.stack([least.min(), largest.max()])
    return RangePyramid(*tables, overall, deepest.max(), block=block)


def _widening(base: Array, reaches: Int[Array, " k"], fill: float, op: Callable[..., Array]) -> Array:
    """`base` and its levels [1 + k, h, w], each joining squares `reaches` blocks apart of the one before."""
    rows, columns = base.shape
    most = 1 << reaches.shape[0]

    def widen(table: Array, reach: Array) -> tuple[Array, Array]:
        padded = jnp.pad(table, ((0, 0), (0, most)), constant_values=fill)
        right = op(table, jax.lax.dynamic_slice(padded, (0, reach), table.shape))
        padded = jnp.pad(right, ((0, most), (0, 0)), constant_values=fill)
        wider = op(right, jax.lax.dynamic_slice(padded, (reach, 0), (rows, columns)))
        return wider, wider

    _, levels = jax.lax.scan(widen, base, reaches)
    return jnp.concatenate([base[None], levels])


def _over_blocks(a: Array, block: int, fill: float, op: Callable[..., Array]) -> Array:
    rows, columns = a.shape
    padded = jnp.pad(a, ((0, -rows % block), (0, -columns % block)), constant_values=fill)
    tiles = padded.reshape(padded.shape[0] // block, block, padded.shape[1] // block, block)
    return op(tiles, axis=(1, 3))
