"""Items done by several processes, of which any may end without taking more than its item with it."""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import jax

from focusjax.batch._work import Task, Worker

_SETTINGS = (
    "jax_enable_x64",
    "jax_enable_compilation_cache",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
)
"""Of JAX, which every process has for itself; those of the process that asks go for all."""
_READY = "ready"
_PATIENCE = 10.0


def work_apart(
    tasks: Sequence[Task], folder: Path, *, jobs: int, solve_only: bool
) -> Iterator[tuple[Task, str]]:
    """Do `tasks` in `jobs` processes; each with what went wrong, or "", in the order they end.

    A process keeps to tasks of one group as long as there are any. One that ends by itself fails the task
    it was at, and another takes its place.

    Raises:
        RuntimeError: processes that end before they are given anything to do.
    """
    waiting = list(tasks)
    settings = {name: getattr(jax.config, name) for name in _SETTINGS}

    def start() -> _Process:
        return _Process(folder, settings, solve_only=solve_only)

    processes = [start() for _ in range(min(jobs, len(tasks)))]
    try:
        while waiting or any(process.task for process in processes):
            heard = wait([process.connection for process in processes])
            for process in [each for each in processes if each.connection in heard]:
                task, message = process.hear()
                if process.gone:
                    processes.remove(process)
                    if waiting:
                        processes.append(start())
                elif waiting:
                    at_work = [each.group for each in processes if each.task]
                    process.give(_take(waiting, process.group, at_work))
                if task is not None:
                    yield task, message
    finally:
        for process in processes:
            process.stop()


def _take(waiting: list[Task], own: str | None, others: Sequence[str | None]) -> Task:
    """The task to do next, taken out of `waiting`: of the `own` group, or of one that no other is at."""
    counts = Counter(task.group for task in waiting)
    group = own if own in counts else max(counts, key=lambda name: (name not in others, counts[name]))
    return waiting.pop(next(i for i, task in enumerate(waiting) if task.group == group))


class _Process:
    """A worker in a process of its own.

    Attributes:
        connection: readable when it has something to say, or is gone.
        task: what it is at.
        group: of the task it was given last.
        gone: whether it has ended.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], *, solve_only: bool):
        # Not forked: JAX has threads, which do not survive that.
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.task: Task | None = None
        self.group: str | None = None
        self.gone = False
        self._ready = False
        self._process = context.Process(
            target=_serve, args=(theirs, folder, settings, solve_only), daemon=True
        )
        with _interrupts_ignored():
            self._process.start()
        # Only the process itself holds its end now, so that we see when it is gone.
        theirs.close()

    def give(self, task: Task) -> None:
        """Set it to work."""
        self.task, self.group = task, task.group
        # If it is gone, hearing of it will tell.
        with contextlib.suppress(OSError):
            self.connection.send(task)

    def hear(self) -> tuple[Task | None, str]:
        """The task it was at, and what it says of it; where it is gone, how it ended.

        Raises:
            RuntimeError: it is gone and has never been ready to work.
        """
        task, self.task = self.task, None
        try:
            message = self.connection.recv()
        except (EOFError, OSError):
            self.gone, message = True, self._end()
            if not self._ready:
                raise RuntimeError(
                    f"a process for the items could not start: {message}; a script that calls run_batch has"
                    ' to do so under `if __name__ == "__main__":`'
                ) from None
        self._ready = True
        return task, message

    def stop(self) -> None:
        """End it, whatever it is at."""
        self._process.terminate()
        self._process.join(_PATIENCE)
        self.connection.close()

    def _end(self) -> str:
        """How it ended, in words."""
        self._process.join(_PATIENCE)
        self.connection.close()
        code = self._process.exitcode
        if code is None or code >= 0:
            return f"its process ended with status {code}"
        name = signal.Signals(-code).name
        hint = ", which often means that memory ran out; try fewer --jobs" if name == "SIGKILL" else ""
        return f"its process was ended by {name}{hint}"


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes started within ignore interrupts, which are for the one that asked: it then ends them."""
    if threading.current_thread() is not threading.main_thread():
        # Only the main thread may say so, and only there do interrupts arrive.
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _serve(connection: Connection, folder: Path, settings: dict[str, Any], solve_only: bool) -> None:
    """What a process does: tasks, until it is ended."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    logging.disable(logging.WARNING)
    # On a GPU, the first process would take all memory.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    for name, value in settings.items():
        jax.config.update(name, value)
    worker = Worker(folder, solve_only=solve_only)
    # An error of the connection means that nobody asks any more.
    with contextlib.suppress(EOFError, OSError):
        connection.send(_READY)
        while True:
            connection.send(worker.attempt(connection.recv()))


def _end_with_parent() -> None:
    """Wait for the process that asked to be gone, and go."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
