"""Seconds of calls, by the clock and of all cores."""

import dataclasses
import statistics
import time
from collections.abc import Callable
from typing import Any, TypeVar

import jax

Name = TypeVar("Name")


@dataclasses.dataclass(frozen=True)
class Timed:
    """What the last of several calls returned, and seconds of all of them; the first one compiles.

    Attributes:
        result: of the last call, when its arrays are there.
        wall: seconds by the clock.
        cpu: seconds of all cores in this process.
    """

    result: Any
    wall: list[float]
    cpu: list[float]

    @property
    def first(self) -> float:
        """Seconds of the first call."""
        return self.wall[0]

    @property
    def median(self) -> float:
        """Of the seconds of the calls after the first."""
        return statistics.median(self.wall[1:])

    @property
    def cpu_median(self) -> float:
        """Of the cores' seconds of the calls after the first."""
        return statistics.median(self.cpu[1:])


def timed(run: Callable[[], Any], repeats: int) -> Timed:
    """Call once, and `repeats` times more."""
    return timed_in_turns({"": run}, repeats)[""]


def timed_in_turns(runs: dict[Name, Callable[[], Any]], repeats: int) -> dict[Name, Timed]:
    """Call each once, and `repeats` times more in turns, so that what else the machine does falls on all."""
    results: dict[Name, Any] = {}
    wall: dict[Name, list[float]] = {name: [] for name in runs}
    cpu: dict[Name, list[float]] = {name: [] for name in runs}
    for _ in range(repeats + 1):
        for name, run in runs.items():
            # So that what it returned last does not take memory beside what it returns now.
            results.pop(name, None)
            start, busy = time.perf_counter(), time.process_time()
            results[name] = jax.block_until_ready(run())
            wall[name].append(time.perf_counter() - start)
            cpu[name].append(time.process_time() - busy)
    return {name: Timed(results[name], wall[name], cpu[name]) for name in runs}
