"""Vectors in numbers, and lengths whose derivative is 0, not undefined, where they are 0."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Pair = tuple[Float[Array, ""], Float[Array, ""]]
"""A vector as two numbers: vmapped, they are whole arrays, which XLA fuses into one pass."""


def length(vector: Float[Array, "2"]) -> Float[Array, ""]:
    """Of a vector."""
    return root(vector @ vector)


def root(square: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The square roots of numbers that are at least 0."""
    return jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
