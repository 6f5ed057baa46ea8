"""Residuals as weighted means over blocks of pixels."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

SIZES = (8, 2)
"""Edges in pixels of the blocks, coarse to fine. Each divides the first."""


def block_means(
    values: Float[Array, "h w 3"], weight: Float[Array, "h w 3"], level: Int[Array, ""]
) -> Float[Array, "n"]:
    """The weighted means of `values` over blocks of `SIZES[level]` pixels, each in units of its spread.

    With weights w that are one over the variances of the values a block gives sum(w v) / sqrt(sum(w)), of
    variance 1. It is spread over as many equal parts as the block has values, of the same sum of squares,
    so that the answer is as long for blocks of all sizes.
    """
    edge = SIZES[0]
    room = [(0, -values.shape[0] % edge), (0, -values.shape[1] % edge), (0, 0)]
    padded, weight = jnp.pad(values, room), jnp.pad(weight, room)

    def means(size: int) -> Callable[[], Float[Array, "n"]]:
        def blocks(a: Array) -> Array:
            high, wide = a.shape[0] // size, a.shape[1] // size
            return a.reshape(high, size, wide, size, 3).sum(axis=(1, 3))

        def one() -> Float[Array, "n"]:
            total = blocks(weight)
            there = total > 0.0
            mean = blocks(weight * padded) / jnp.sqrt(jnp.where(there, total, 1.0))
            mean = jnp.where(there, mean, 0.0) / size
            return jnp.repeat(jnp.repeat(mean, size, axis=0), size, axis=1).reshape(-1)

        return one

    return jax.lax.switch(level, [means(size) for size in SIZES])
