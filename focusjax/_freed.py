"""Memory of large arrays, for the system to have again when they are freed."""

import ctypes
import functools
from collections.abc import Callable

_MANY = 3 << 20
_BLOCK = 4 << 20
"""Bytes."""
_M_MMAP_THRESHOLD = -3


def keep_blocks_apart(numbers: int) -> None:
    """From now on the C library (glibc) gives each array of 4 MiB or more memory of its own.

    It goes back to the system with the array. Else the library makes arrays of up to 32 MiB share memory
    after a while, and between those that stay there are holes that others do not fit into. This goes for
    the whole process. Of small arrays only it would only take time.

    Args:
        numbers: about how many the arrays will hold.
    """
    if numbers >= _MANY:
        _function("mallopt")(_M_MMAP_THRESHOLD, _BLOCK)


def return_freed(numbers: int) -> None:
    """Gives memory that was freed back to the system, where the C library can (glibc) and it is worth it.

    Smaller arrays than those that are kept apart leave holes, too. Of few it would only take time, as what
    is given back has to be asked for again.

    Args:
        numbers: about how many such arrays hold.
    """
    if numbers >= _MANY:
        _function("malloc_trim")(0)


@functools.cache
def _function(name: str) -> Callable[..., object]:
    """One of the C library, or nothing if it has none of the name."""
    try:
        return getattr(ctypes.CDLL(None), name)
    except (OSError, AttributeError, TypeError):
        return lambda *_: None
