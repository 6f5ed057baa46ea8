"""Work spread over the processor's cores by threads: numpy and compiled programs let go of Python's lock."""

import concurrent.futures
import os
import threading
from collections.abc import Callable, Iterable
from typing import ParamSpec, TypeVar

import jax

P = ParamSpec("P")
T = TypeVar("T")
R = TypeVar("R")

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
"""Cores that this process may use."""
_thread = threading.local()


def use_cores(count: int) -> None:
    """From now on `in_parallel` uses so many threads, as where other processes use the other cores."""
    global CORES
    CORES = count


def in_parallel(function: Callable[[T], R], items: Iterable[T], *, threads: int | None = None) -> list[R]:
    """`function` of every item, in the order of the items, by a thread for each core or so many `threads`.

    Within a `function` that runs beside others, the cores are taken: what it does in parallel itself is done
    by its own thread.
    """
    work = list(items)
    if CORES == 1 or len(work) <= 1 or getattr(_thread, "beside_others", False):
        return [function(item) for item in work]
    with concurrent.futures.ThreadPoolExecutor(
        min(CORES, threads or CORES), initializer=_mark_thread
    ) as pool:
        return list(pool.map(in_this_precision(function), work))


def _mark_thread() -> None:
    """This thread is one of several that share the cores."""
    _thread.beside_others = True


def in_this_precision(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, to be called by another thread, in the floating-point precision that holds here.

    `jax.enable_x64` used as a context holds only in the thread that entered it.
    """
    double = bool(jax.config.jax_enable_x64)  # pyright: ignore[reportAttributeAccessIssue]

    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        with jax.enable_x64(double):
            return function(*args, **kwargs)

    return called


def parts(length: int, at_once: int) -> list[slice]:
    """Slices of at most `at_once` that together make up `length`."""
    return [slice(start, min(start + at_once, length)) for start in range(0, length, at_once)]
