"""Indices and other whole numbers that are at least 0, without what JAX does for negative ones.

That is a comparison and a choice for every look-up, and several for every division.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Shaped


def taken(array: Shaped[Array, " n"], index: Int[Array, "*k"]) -> Shaped[Array, "*k"]:
    """The elements of `array` at indices, all within it."""
    return array.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def divided(number: Int[Array, "*n"], by: int | Int[Array, ""]) -> tuple[Int[Array, "*n"], Int[Array, "*n"]]:
    """Quotient and remainder of numbers at least 0."""
    divisor = jnp.full(number.shape, by, dtype=number.dtype)
    return jax.lax.div(number, divisor), jax.lax.rem(number, divisor)
