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
    wanted = None if dtype is None else jax.dtypes.canonicalize_dtype(dtype)
    # What is no array is refused where it does not fit, as `jnp.asarray` does.
    known = values if isinstance(values, np.ndarray) else np.asarray(values, dtype=wanted)
    return jax.device_put(np.array(known, dtype=wanted or jax.dtypes.canonicalize_dtype(known.dtype)))
