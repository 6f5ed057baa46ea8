"""Sums and extremes of a handful of terms, written out."""

import functools

import jax.numpy as jnp
from jaxtyping import Array, Float


def sum_of_few(terms: Float[Array, "n *m"]) -> Float[Array, "*m"]:
    """Sum along the first axis, written out term by term.

    XLA for CPU hands a reduction along an axis to a library, which for a handful of terms takes several times
    as long as adding them where they are made.
    """
    return functools.reduce(jnp.add, jnp.unstack(terms))


def least_of_few(terms: Float[Array, "n *m"]) -> Float[Array, "*m"]:
    """Minimum along the first axis; see `sum_of_few`."""
    return functools.reduce(jnp.minimum, jnp.unstack(terms))


def largest_of_few(terms: Float[Array, "n *m"]) -> Float[Array, "*m"]:
    """Maximum along the first axis; see `sum_of_few`."""
    return functools.reduce(jnp.maximum, jnp.unstack(terms))
