"""Seconds per stage of a run, with JAX's compile time told apart from the work."""

import contextlib
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
    def stage(self, name: str, *, compile_apart: bool = True) -> Iterator[None]:
        """Count the block's time under `name`; stages do not nest, and each happens once."""
        if self._on_stage is not None:
            self._on_stage(name)
        compiling = 0.0

        def note(event: str, duration_secs: float, **details: object) -> None:
            nonlocal compiling
            if event.startswith(_COMPILE_EVENTS):
                compiling += duration_secs

        jax.monitoring.register_event_duration_secs_listener(note)
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            jax.monitoring.unregister_event_duration_listener(note)
            # Compiling may overlap with itself when JAX uses threads, but never counts for more than all.
            compiling = min(compiling, elapsed) if compile_apart else 0.0
            self.compile_seconds[name] = compiling
            self.seconds[name] = elapsed - compiling
