"""A scheduler and workers of Dask, started by their own commands, which end with the block."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import distributed

ROOT = Path(__file__).parents[2]
PATIENCE = 120.0


def until(condition):
    """What `condition` returns once that is true."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)
    return found


class Processes:
    """The processes of a cluster.

    Attributes:
        file: the scheduler file.
        scheduler: its process.
        workers: theirs; each has a nanny, which starts another when it is killed.
    """

    def __init__(self, folder: Path, path: str):
        self._folder = folder
        self._path = path
        self._started: list[subprocess.Popen] = []
        self.restart_scheduler()

    def restart_scheduler(self):
        self.file = self._folder / f"scheduler{len(self._started)}.json"
        words = ["--port", "0", "--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", self.file]
        self.scheduler = self._start("dask_scheduler", *words)
        until(self.file.exists)

    def start_workers(self, count):
        for _ in range(count):
            words = [
                "--nthreads",
                "1",
                "--no-dashboard",
                "--scheduler-file",
                self.file,
                "--host",
                "127.0.0.1",
            ]
            self._start("dask_worker", *words, "--local-directory", self._folder)

    def _start(self, module, *words):
        with (self._folder / f"{module}{len(self._started)}.log").open("w") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *map(str, words)],
                env=os.environ
                | {"PYTHONPATH": self._path, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s"},
                cwd=self._folder,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._started.append(process)
        return process

    def end(self):
        """Whole sessions: nannies, and the workers that they started."""
        for process in self._started:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@contextmanager
def processes(folder, count=2, *, path=""):
    """A scheduler with `count` workers, whose modules are found in `path` before all others."""
    cluster = Processes(folder, path or f"{ROOT}:{Path(__file__).parent}")
    try:
        cluster.start_workers(count)
        if count:
            with distributed.Client(scheduler_file=str(cluster.file), set_as_default=False) as client:
                client.wait_for_workers(count, timeout=PATIENCE)
        yield cluster
    finally:
        cluster.end()
