"""Known numbers as arrays of JAX."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


def device_array(values: Any, dtype: Any = None) -> Array:
    """`values` as `jnp.asarray` makes an array of them, without the program that it compiles for every shape.

    Args:
        values: known numbers, which are copied; arrays of JAX, traced or not, as they are.
        dtype: of the result; that of the values when not given.

    Example:
        >>> device_array([[1, 2], [3, 4]], dtype=float)[1].tolist()
        [3.0, 4.0]
    """
    if isinstance(values, jax.Array):
        return jnp.asarray(values, dtype=dtype)
    known = np.asarray(values)
    wanted = jax.dtypes.canonicalize_dtype(known.dtype if dtype is None else dtype)
    return jax.device_put(np.array(known, dtype=wanted))
