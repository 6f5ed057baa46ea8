"""Counts and seeds that a user gives: whole numbers from 1, and from 0 on."""

import operator
from typing import Any

from focusjax._arguments import ArgumentError

MOST_SEED = 2**32 - 1


def require_counts(**counts: Any) -> None:
    """Refuse counts, given by the names the user knows them by, that are not whole or below 1.

    Raises:
        ArgumentError: (a `ValueError`) naming the count and its value.

    Example:
        >>> require_counts(rays=64)
        >>> require_counts(rays=0)
        Traceback (most recent call last):
        focusjax._arguments.ArgumentError: rays is 0; expected a whole number, at least 1
    """
    for name, count in counts.items():
        if not _whole(count, least=1):
            raise ArgumentError(f"{name} is {count!r}; expected a whole number, at least 1", name)


def require_seed(seed: Any) -> int:
    """A seed as a plain number, of any whole type or an array without axes; refuses what is none.

    Raises:
        ArgumentError: (a `ValueError`) naming it; one of more than 32 bits, which would be that of another.

    Example:
        >>> require_seed(7)
        7
        >>> require_seed(-1)
        Traceback (most recent call last):
        focusjax._arguments.ArgumentError: seed is -1; expected a whole number from 0 to 4294967295
    """
    if not _whole(seed, least=0) or operator.index(seed) > MOST_SEED:
        raise ArgumentError(f"seed is {seed!r}; expected a whole number from 0 to {MOST_SEED}", "seed")
    return operator.index(seed)


def later_seed(seed: int, number: int) -> int:
    """The seed so many after this one, from 0 on again after the last.

    Example:
        >>> later_seed(2**32 - 1, 3)
        2
    """
    return (seed + number) % (MOST_SEED + 1)


def _whole(value: Any, *, least: int) -> bool:
    try:
        return not isinstance(value, bool) and operator.index(value) >= least
    except TypeError:
        return False
