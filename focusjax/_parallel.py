"""Work spread over the processor's cores by threads: numpy and compiled programs let go of Python's lock."""

import concurrent.futures
import os
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
"""Cores that this process may use."""


def in_parallel(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """`function` of every item, in the order of the items."""
    work = list(items)
    if CORES == 1 or len(work) <= 1:
        return [function(item) for item in work]
    with concurrent.futures.ThreadPoolExecutor(CORES) as pool:
        return list(pool.map(function, work))


def parts(length: int, at_once: int) -> list[slice]:
    """Slices of at most `at_once` that together make up `length`."""
    return [slice(start, min(start + at_once, length)) for start in range(0, length, at_once)]
