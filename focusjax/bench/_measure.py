"""Seconds and memory of one method on one case, within the process that this runs in."""

import dataclasses
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from focusjax.bench._case import Case
from focusjax.bench._methods import Method, Setting


@dataclasses.dataclass(frozen=True)
class Timing:
    """One setting of a method.

    Attributes:
        setting: what the method was given.
        first_seconds: of the first call, which compiles.
        seconds: median of the calls after it.
        best_seconds: least of them.
        peak_mib: most memory that the process has held so far.
    """

    setting: Setting
    first_seconds: float
    seconds: float
    best_seconds: float
    peak_mib: float


@dataclasses.dataclass(frozen=True)
class Measured:
    """One method on one case.

    Attributes:
        setup_first_seconds: of the first set-up, which compiles.
        setup_seconds: of the second.
        start_mib: memory that the process held before the set-up.
        timings: one for each setting, in the method's order.
    """

    setup_first_seconds: float
    setup_seconds: float
    start_mib: float
    timings: tuple[Timing, ...]


def measure(
    method: Method,
    case: Case,
    *,
    repeats: int,
    keep: Callable[[int, Float[np.ndarray, "h w 3"]], None],
    note: Callable[[Measured], None] = lambda _: None,
) -> Measured:
    """Set up twice, then make the picture of every setting once and `repeats` times more.

    Args:
        method: what to measure.
        case: the picture to make.
        repeats: timed calls after the first, at least 1.
        keep: given the number of each setting and its picture.
        note: given all that is measured so far, after each setting.
    """
    start = peak_memory()
    _, setup_first = _timed(lambda: method.prepare(case))
    prepared, setup = _timed(lambda: method.prepare(case))
    measured = Measured(setup_first, setup, start, ())
    for number, setting in enumerate(method.settings):
        picture, first = _timed(lambda setting=setting: method.render(case, prepared, setting))
        seconds = [
            _timed(lambda setting=setting: method.render(case, prepared, setting))[1] for _ in range(repeats)
        ]
        timing = Timing(setting, first, statistics.median(seconds), min(seconds), peak_memory())
        measured = dataclasses.replace(measured, timings=(*measured.timings, timing))
        keep(number, np.asarray(picture, dtype=np.float64))
        note(measured)
    return measured


def peak_memory() -> float:
    """Most memory that this process has held so far, in MiB."""
    status = Path("/proc/self/status")
    if status.exists():
        # Linux's rusage would start from what the parent process held.
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 2**10
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def _timed(run: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = jax.block_until_ready(run())
    return result, time.perf_counter() - start
