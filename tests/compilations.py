"""What XLA compiles or reads, counted, for tests of what must not be compiled again."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax

from focusjax._program_files import READ


@contextmanager
def compilations() -> Iterator[list[str]]:
    """The name of each program that is compiled meanwhile, or read where it was kept before."""
    compiled: list[str] = []

    def listen(event: str, _seconds: float, **about: object) -> None:
        if event in ("/jax/core/compile/backend_compile_duration", READ):
            compiled.append(str(about["fun_name"]))

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield compiled
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)
