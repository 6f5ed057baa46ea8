"""Seconds per stage of a run, with JAX's compile time counted apart from the work."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator

import jax

_COMPILE_EVENTS = "/jax/core/compile/"


class Stopwatch:
    """Times stages one after another.

    Attributes:
        seconds: wall-clock seconds of each stage, compile time left out.
        compile_seconds: seconds of each stage that JAX spent tracing, lowering and compiling.
    """

    def __init__(self, on_stage: Callable[[str], None] | None = None):
        self.seconds: dict[str, float] = {}
        self.compile_seconds: dict[str, float] = {}
        self._on_stage = on_stage

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block's time under `name`; stages do not nest, and each happens once."""
        if self._on_stage is not None:
            self._on_stage(name)
        spans: list[tuple[float, float]] = []

        def note(event: str, duration_secs: float, **details: object) -> None:
            if event.startswith(_COMPILE_EVENTS):
                end = time.perf_counter()
                spans.append((end - duration_secs, end))

        jax.monitoring.register_event_duration_secs_listener(note)
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            jax.monitoring.unregister_event_duration_listener(note)
            compiling = min(_together(spans), elapsed)
            self.compile_seconds[name] = compiling
            self.seconds[name] = elapsed - compiling


def _together(spans: list[tuple[float, float]]) -> float:
    """Seconds within any of the spans (start, end), which overlap where threads compile side by side."""
    total, covered = 0.0, -math.inf
    for start, end in sorted(spans):
        total += max(0.0, end - max(start, covered))
        covered = max(covered, end)
    return total
