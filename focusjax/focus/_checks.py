"""One way to refuse a value, whether it is known now or only when compiled code runs."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from focusjax._arguments import ArgumentError, about, real_number
from focusjax._words import shown


def require(
    value: Float[Array, "*shape"],
    holds: Callable[[Any], Any],
    what: str,
    expected: str,
    argument: str,
) -> Float[Array, "*shape"]:
    """`value`, when `holds` is true of all its entries.

    Args:
        value: what to check.
        holds: elementwise test, made of comparisons; NaN therefore fails it.
        what: the value's name, which starts the message.
        expected: what the value should have been, which ends it.
        argument: see `ArgumentError`.

    Raises:
        ArgumentError: the value is known and fails the test. Where values are not known yet, inside a JAX
            transformation, the error is raised when the compiled code runs, without the value.
    """
    # Known values are tested by numpy: a dozen checks are then too quick to notice in a solve.
    ok = holds(known(value))
    if isinstance(ok, Tracer):
        return eqx.error_if(value, ~jnp.all(ok), f"{what} is out of range; expected {expected}")
    if not np.all(ok):
        wrong = np.asarray(value)[~np.asarray(ok)].flat[0]
        raise ArgumentError(f"{what} is {shown(wrong)}; expected {expected}", argument)
    return value


def known(value: Any) -> Any:
    """A value as numpy has it, to compare with; one that is traced as it is."""
    return value if isinstance(value, Tracer) else np.asarray(value)


def require_number(
    value: Any, holds: Callable[[Any], Any], what: str, expected: str, argument: str
) -> Float[Array, ""]:
    """`value` as an array, when it is one number of which `holds` is true; arguments as for `require`."""
    if not isinstance(value, Tracer):
        with about(argument):
            value = real_number(value, what, expected)
    return require(jnp.asarray(value, dtype=float), holds, what, expected, argument)


def require_weight(name: str, value: Any) -> Float[Array, ""]:
    """`value` as an array, when it can weigh a term of a solve; `name` is that of the argument."""
    return require_number(
        value, lambda v: (v >= 0) & (v < np.inf), name, "zero or a positive finite number", name
    )
