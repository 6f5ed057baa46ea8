"""Memory that was freed, for the system to have again."""

import ctypes
import functools
from collections.abc import Callable

_MANY = 3 << 20


def return_freed(numbers: int) -> None:
    """Gives memory that was freed back to the system, where the C library can (glibc) and it is worth it.

    Arrays of some megabytes that come and go leave holes that no larger one fits into: of layers of many
    samples, a third of what a process holds at most would be holes. Of few it would only take time, as
    what is given back has to be asked for again.

    Args:
        numbers: about how many such arrays hold.
    """
    if numbers >= _MANY:
        _trim()(0)


@functools.cache
def _trim() -> Callable[[int], object]:
    """What gives memory back: malloc_trim of glibc, or nothing."""
    try:
        return ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):
        return bool
