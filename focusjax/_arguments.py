"""Arguments that are not what they should be, refused in words where nobody checks types."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, SupportsFloat

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from focusjax._words import kind_of


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


def require_known(value: object, usage: str, remedy: str, argument: str) -> None:
    """Refuse what a JAX transformation traces, where its numbers have to be known.

    Args:
        value: a tree of arrays.
        usage: the call with its arguments in order.
        remedy: why, and what to do instead.
        argument: the argument's name.
    """
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(value)):
        raise ArgumentError(
            f"{argument} of {usage} is traced by JAX, but has to be known: {remedy}", argument
        )


def require_switches(**switches: Any) -> None:
    """Refuse switches, given by their names, that are neither true nor false: any text would be true.

    Raises:
        ValueError: naming the switch and its value.

    Example:
        >>> require_switches(smooth=False)
        >>> require_switches(smooth="no")
        Traceback (most recent call last):
        focusjax._arguments.ArgumentError: smooth is 'no'; expected True or False
    """
    for name, value in switches.items():
        if not isinstance(value, bool | np.bool_):
            raise ArgumentError(f"{name} is {value!r}; expected True or False", name)


def real_number(value: Any, what: str, expected: str) -> float:
    """A real number, in any range, of a Python or numpy type or an array without axes.

    Args:
        value: what was given.
        what: the value's name, which starts the message.
        expected: what it should have been, which ends the message.

    Raises:
        ValueError: text, True or False, None, several numbers, or anything else.

    Example:
        >>> real_number(np.float32(2), "the distance in metres", "a positive number")
        2.0
        >>> real_number("2", "the distance in metres", "a positive number")
        Traceback (most recent call last):
        ValueError: the distance in metres is '2'; expected a positive number
    """
    if type(value) in (float, int):
        return float(value)
    if isinstance(value, Tracer):
        raise ValueError(f"{what} is traced by JAX, but has to be known; expected {expected}")
    if not isinstance(value, SupportsFloat) or np.ndim(value) or not _real(value):  # pyright: ignore[reportArgumentType]  # any number has 0 axes
        _refuse(value, what, expected)
    return float(value)


def number_or_traced(value: Any, what: str, expected: str) -> Any:
    """A real number as `real_number` makes it, or one that a JAX transformation traces, as it is.

    Raises:
        ValueError: as `real_number`; an array with axes.
    """
    if not isinstance(value, Tracer):
        return real_number(value, what, expected)
    if value.shape or not _real(value):
        _refuse(value, what, expected)
    return value


def real_numbers(value: Any, what: str, expected: str) -> Float[np.ndarray, "..."]:
    """Real numbers in an array of any shape, which is not looked at; arguments as for `real_number`.

    Raises:
        ValueError: rows of several lengths, or what `real_number` refuses.
    """
    if isinstance(value, Tracer):
        raise ValueError(f"{what} are traced by JAX, but have to be known; expected {expected}")
    try:
        array = np.asarray(value)
        if array.dtype == object:
            array = np.array([real_number(each, what, expected) for each in array.flat]).reshape(array.shape)
    except ValueError:
        _refuse(value, what, expected)
    if not _real(array):
        _refuse(value, what, expected)
    return array.astype(float, copy=False)


def _real(value: Any) -> bool:
    """Whether a number, or the numbers of an array, are neither true or false, complex, nor text."""
    dtype = getattr(value, "dtype", None)
    if dtype is None:
        return not isinstance(value, bool | complex)
    # Those of JAX include types that numpy takes for records.
    return any(jax.dtypes.issubdtype(dtype, kind) for kind in (np.floating, np.integer))


def _refuse(value: Any, what: str, expected: str) -> NoReturn:
    plain = value is None or isinstance(value, str | bool | int | float)
    said = repr(value) if plain or len(repr(value)) <= 40 else kind_of(value)
    raise ValueError(f"{what} is {said}; expected {expected}") from None
