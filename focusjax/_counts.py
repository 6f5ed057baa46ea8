"""Counts and seeds that a user gives: whole numbers from 1, and from 0 on."""

import operator
from typing import Any


def require_counts(**counts: Any) -> None:
    """Refuse counts, given by the names the user knows them by, that are not whole or below 1.

    Raises:
        ValueError: naming the count and its value.

    Example:
        >>> require_counts(rays=64)
        >>> require_counts(rays=0)
        Traceback (most recent call last):
        ValueError: rays is 0; expected a whole number, at least 1
    """
    for name, count in counts.items():
        if not _whole(count, least=1):
            raise ValueError(f"{name} is {count!r}; expected a whole number, at least 1")


def require_seed(seed: Any) -> None:
    """Refuse what chooses no random numbers.

    Raises:
        ValueError: naming it.

    Example:
        >>> require_seed(7)
        >>> require_seed(-1)
        Traceback (most recent call last):
        ValueError: seed is -1; expected a whole number, zero or more
    """
    if not _whole(seed, least=0):
        raise ValueError(f"seed is {seed!r}; expected a whole number, zero or more")


def _whole(value: Any, *, least: int) -> bool:
    try:
        return not isinstance(value, bool) and operator.index(value) >= least
    except TypeError:
        return False
