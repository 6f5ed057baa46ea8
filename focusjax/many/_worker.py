"""What a process does that works for others: settings, a look at the folder, and tasks one at a time."""

import logging
import os
import platform
import signal
import threading
import traceback
import uuid
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import jax

from focusjax import _parallel
from focusjax._freed import return_programs
from focusjax.many._journal import Journal
from focusjax.many._task import Ended, Task, sentence

Work = Callable[[Task, Journal], Any]
"""Does a task and returns what is to be known of it. It goes to other processes by pickle."""
ENVIRONMENT = {"NPROC": "1", "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
"""Of a process that shares a machine with others: one core, and no more of a GPU's memory than it takes."""
_PROGRAMS = "jax_compilation_cache_dir"
_SETTINGS = (
    "jax_enable_x64",
    "jax_enable_compilation_cache",
    _PROGRAMS,
    "jax_persistent_cache_min_compile_time_secs",
)
"""Of JAX, which every process has for itself; those of the process that asks go for all."""
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class Settings:
    """What all processes of a run have alike.

    Attributes:
        jax: settings of JAX by name.
        local: whether the processes are this machine's own, started for the run.
    """

    jax: dict[str, Any]
    local: bool

    @classmethod
    def here(cls, *, local: bool) -> "Settings":
        """Those of this process."""
        return cls({name: getattr(jax.config, name) for name in _SETTINGS}, local)

    def apply(self, number: int = 0) -> None:
        """Set this process up, before it does anything.

        Args:
            number: of the process among those of this machine; where there are GPUs it says which is its own.
        """
        _parallel.use_cores(1)
        for name, value in self.jax.items():
            # A process that keeps compiled programs somewhere goes on doing so.
            if self.local or name != _PROGRAMS or getattr(jax.config, name) is None:
                jax.config.update(name, value)
        if not self.local:
            return
        logging.disable(logging.WARNING)
        gpus = sorted(Path("/dev").glob("nvidia[0-9]*"))
        if gpus:
            os.environ.setdefault("CUDA_VISIBLE_DEVICES", str(number % len(gpus)))
        if threading.current_thread() is threading.main_thread():
            # Interrupts are for the process that asks, which then ends this one.
            signal.signal(signal.SIGINT, signal.SIG_IGN)


def attempt(work: Work, task: Task, journal: Journal) -> Ended:
    """Do a task; what it raises becomes `Ended.error`, and goes no further."""
    with _ONE_AT_A_TIME:
        try:
            journal.started(task.name)
            value = work(task, journal)
            journal.ended(task.name)
        except Exception as error:
            # Where even that fails, the folder cannot be reached, which is why the task failed.
            with suppress(OSError):
                journal.ended(task.name)
            return Ended(task, error=sentence(error), log=traceback.format_exc())
        finally:
            return_programs()
    return Ended(task, value)


@contextmanager
def warnings_kept() -> Iterator[list[str]]:
    """Our own warnings as texts; those of other libraries say nothing to a user."""
    texts: list[str] = []

    def keep(message: Warning | str, category: type[Warning], *rest: object, **more: object) -> None:
        if category is UserWarning and str(message) not in texts:
            texts.append(str(message))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("always", category=UserWarning, module="focusjax|__main__")
        warnings.showwarning = keep
        yield texts


def versions() -> dict[str, str]:
    """What has to be the same in all processes of a run, for their results to be."""
    names = ("focusjax", "jax", "jaxlib")
    return {name: _version(name) for name in names} | {"Python": platform.python_version()}


def write_probe(folder: Path, token: str) -> str:
    """Leave a small file in a folder, to be read back by another process; returns its name.

    Raises:
        OSError: it cannot be written; without the file's name.
    """
    name = f".probe-{token}-{uuid.uuid4().hex[:12]}"
    try:
        (folder / name).write_text(token)
    except OSError as error:
        raise OSError(error.strerror or str(error)) from None
    return name


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "none"
