"""Lengths and directions whose values and gradients stay finite for the zero vector."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Planes = tuple[Float[Array, "_"], ...]
"""One flat array per component: on a CPU, gathering these is faster than gathering rows."""


def dot(left: Float[Array, "n"], right: Float[Array, "n"]) -> Float[Array, ""]:
    """Inner product, as a sum: a million small matrix products are many times slower on a CPU."""
    return jnp.sum(left * right)


def norm(vector: Float[Array, "n"]) -> Float[Array, ""]:
    """Euclidean length; its gradient at the zero vector is zero."""
    square = dot(vector, vector)
    zero = square == 0.0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))


def unit(vector: Float[Array, "n"], *, otherwise: Float[Array, "n"]) -> Float[Array, "n"]:
    """`vector` scaled to length 1, or `otherwise` when it is zero."""
    # Squares of short vectors underflow, so the largest component is taken out first.
    largest = jnp.max(jnp.abs(vector))
    scaled = vector / jnp.where(largest == 0.0, 1.0, largest)
    length = norm(scaled)
    return jnp.where(length == 0.0, otherwise, scaled / jnp.where(length == 0.0, 1.0, length))
