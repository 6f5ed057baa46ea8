"""Zeros that a compiled program makes when it needs them."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array


def zeros_after(known: Array, shape: tuple[int, ...], dtype: Any = None) -> Array:
    """Zeros of `shape`, made no sooner than `known` is, of which whole numbers are not negative.

    XLA makes zeros that depend on nothing at the start of a program, where they take memory from all that
    goes before their first use; and it drops barriers before it puts steps in order. So these depend on a
    number that is 0 whatever `known` is.
    """
    first = known.reshape(-1)[0]
    number = jnp.isnan(first) if jnp.issubdtype(known.dtype, jnp.inexact) else first
    zero = jnp.minimum(number.astype(jnp.int32), 0)
    return jnp.broadcast_to(zero.astype(jnp.zeros(()).dtype if dtype is None else dtype), shape)
