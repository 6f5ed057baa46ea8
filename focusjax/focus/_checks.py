"""One way to refuse a value, whether it is known now or only when compiled code runs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from focusjax._words import kind_of, shown


class ArgumentError(ValueError):
    """An argument that cannot be as it is.

    Attributes:
        argument: which one, with its parts after dots: "f_number_range.0" is the range's start, and
            "points.2.where" the place of the third wish.
    """

    def __init__(self, message: str, argument: str):
        super().__init__(message)
        self.argument = argument


@contextmanager
def about(argument: str) -> Iterator[None]:
    """Says of every `ValueError` inside which argument it is about, unless that is known already."""
    try:
        yield
    except ArgumentError:
        raise
    except ValueError as error:
        raise ArgumentError(str(error), argument) from error


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
    known = not isinstance(value, Tracer)
    ok = holds(np.asarray(value) if known else value)
    if isinstance(ok, Tracer):
        return eqx.error_if(value, ~jnp.all(ok), f"{what} is out of range; expected {expected}")
    if not np.all(ok):
        wrong = np.asarray(value)[~np.asarray(ok)].flat[0]
        raise ArgumentError(f"{what} is {shown(wrong)}; expected {expected}", argument)
    return value


def require_kind(
    value: object, kinds: type | tuple[type, ...], usage: str, remedy: str, argument: str
) -> None:
    """Refuse a value of another class, for callers who do not check types.

    Args:
        value: what was given.
        kinds: classes that will do.
        usage: the call with its arguments in order, such as "solve(points, camera, lens)".
        remedy: how to come by one.
        argument: the argument's name.
    """
    if not isinstance(value, kinds):
        names = " or ".join(kind.__name__ for kind in (kinds if isinstance(kinds, tuple) else (kinds,)))
        raise ArgumentError(
            f"{argument} of {usage} is {kind_of(value)}; expected {names}: {remedy}", argument.split()[-1]
        )
