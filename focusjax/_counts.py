"""Counts that a user gives: whole numbers from 1 on."""

import operator
from typing import Any


def require_counts(**counts: Any) -> None:
    """Refuse counts, given by the names the user knows them by, that are not whole or below 1.

    None stands for one that was not given.

    Raises:
        ValueError: naming the count and its value.

    Example:
        >>> require_counts(rays=64)
        >>> require_counts(rays=0)
        Traceback (most recent call last):
        ValueError: rays is 0; expected a whole number, at least 1
    """
    for name, count in counts.items():
        if count is None:
            continue
        try:
            enough = not isinstance(count, bool) and operator.index(count) >= 1
        except TypeError:
            enough = False
        if not enough:
            raise ValueError(f"{name} is {count!r}; expected a whole number, at least 1")
