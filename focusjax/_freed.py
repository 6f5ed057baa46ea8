"""Memory of large arrays and of compiled programs, for the system to have again when they are freed."""

import contextlib
import ctypes
import functools
import gc
from collections.abc import Callable, Iterator
from pathlib import Path

import jax

from focusjax._programs import forget_programs

_MANY = 3 << 20
_BLOCK = 4 << 20
"""Bytes."""
_M_MMAP_THRESHOLD = -3
_MOST_MAPPINGS = 48000
"""Of memory, below the 65530 that Linux allows a process: each compiled program takes some."""
_MORE_MAPPINGS = 24000
"""Than were left when programs were last let go: some are held elsewhere, and stay."""
_COMPILED, _LONG = "/jax/core/compile/backend_compile_duration", 1.0
"""The event after a program is compiled, and how many seconds a large one takes at least."""
_left = 0


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


@contextlib.contextmanager
def returned_after_compiling(numbers: int) -> Iterator[None]:
    """Within it, memory that compiling a large program took is given back before the program runs.

    XLA takes half a GB for the largest, in pieces that are freed but stay with the process.

    Args:
        numbers: about how many the arrays will hold that there has to be room for.
    """

    def compiled(event: str, duration_secs: float, **details: object) -> None:
        if event == _COMPILED and duration_secs > _LONG:
            return_freed(numbers)

    if numbers < _MANY:
        yield
        return
    jax.monitoring.register_event_duration_secs_listener(compiled)
    try:
        yield
    finally:
        jax.monitoring.unregister_event_duration_listener(compiled)


def return_programs() -> None:
    """Forgets compiled programs before there are more of them than a process can map into memory.

    The next one beyond would end the process. Call it between things that compile programs of their own.
    """
    global _left
    if _mappings() > min(_left + _MORE_MAPPINGS, _MOST_MAPPINGS):
        forget_programs()
        gc.collect()
        _left = _mappings()


def _mappings() -> int:
    """How many parts of memory this process has mapped; 0 where the system does not say."""
    maps = Path("/proc/self/maps")
    return maps.read_bytes().count(b"\n") if maps.exists() else 0


@functools.cache
def _function(name: str) -> Callable[..., object]:
    """One of the C library, or nothing if it has none of the name."""
    try:
        return getattr(ctypes.CDLL(None), name)
    except (OSError, AttributeError, TypeError):
        return lambda *_: None
