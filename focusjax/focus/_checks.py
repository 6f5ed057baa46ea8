"""One way to refuse a value, whether it is known now or only when compiled code runs."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float


def require(
    value: Float[Array, "*shape"],
    holds: Callable[[Any], Any],
    what: str,
    expected: str,
) -> Float[Array, "*shape"]:
    """`value`, when `holds` is true of all its entries.

    Args:
        value: what to check.
        holds: elementwise test, made of comparisons; NaN therefore fails it.
        what: the value's name, which starts the message.
        expected: what the value should have been, which ends it.

    Raises:
        ValueError: the value is known and fails the test. Where values are not known yet, inside a JAX
            transformation, the error is raised when the compiled code runs, without the value.
    """
    # Known values are tested by numpy: a dozen checks are then too quick to notice in a solve.
    known = not isinstance(value, Tracer)
    ok = holds(np.asarray(value) if known else value)
    if isinstance(ok, Tracer):
        return eqx.error_if(value, ~jnp.all(ok), f"{what} is out of range; expected {expected}")
    if not np.all(ok):
        wrong = np.asarray(value)[~np.asarray(ok)].flat[0]
        raise ValueError(f"{what} is {wrong:.7g}; expected {expected}")
    return value
