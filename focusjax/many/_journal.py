"""The history of each task: when it was started, where, and when it was finished."""

import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from focusjax.io import whole_folder

JOURNAL = "journal.jsonl"
"""In the folder of a finished task: a line of JSON for each start, and one for the finish."""
MOST_STARTS = 3
"""After so many starts in one run, of which none came to an end, a task is failed."""
_FOLDER = ".journals"


@dataclass(frozen=True)
class Journal:
    """Histories of the tasks that are under way, a file each, in a folder that all workers see.

    A line is written before a task is begun, so that a process that is killed leaves its start behind. A task
    that ends takes its file away; so there are no more files than tasks under way.

    Attributes:
        folder: of the run.
        run: an identifier of the run, of which starts are counted.
    """

    folder: Path
    run: str

    def open(self) -> None:
        """Make the folder of the files."""
        (self.folder / _FOLDER).mkdir(exist_ok=True)

    def close(self) -> None:
        """Remove the folder, if no task is left in it."""
        with suppress(OSError):
            (self.folder / _FOLDER).rmdir()

    def clear(self) -> None:
        """Remove what is left of tasks that were under way."""
        for path in (self.folder / _FOLDER).glob("*.jsonl"):
            path.unlink(missing_ok=True)
        self.close()

    def started(self, name: str) -> None:
        """Count a start.

        Raises:
            RuntimeError: too many starts of this run did not come to an end.
        """
        starts = self.starts(name)
        if len(starts) >= MOST_STARTS:
            raise RuntimeError(often_killed(starts))
        with self._file(name).open("a", encoding="utf-8") as stream:
            stream.write(self._line("started"))

    def starts(self, name: str) -> list[dict[str, Any]]:
        """The starts of a task in this run that did not come to an end."""
        return [line for line in read_journal(self._file(name)) if line["run"] == self.run]

    def ended(self, name: str) -> None:
        """Take the history away, unless another run has begun the task since."""
        lines = read_journal(self._file(name))
        if not lines or lines[-1]["run"] == self.run:
            self._file(name).unlink(missing_ok=True)

    def finish(self, name: str, earlier: str = "") -> str:
        """The whole history of a task that is about to be finished.

        Args:
            name: of the task.
            earlier: what there was before, of a result that is replaced.
        """
        with suppress(FileNotFoundError):
            earlier += self._file(name).read_text(encoding="utf-8")
        return earlier + self._line("finished")

    def _file(self, name: str) -> Path:
        return self.folder / _FOLDER / f"{name}.jsonl"

    def _line(self, event: str) -> str:
        facts = {"event": event, "run": self.run, "time": time.time()}
        return json.dumps(facts | {"host": socket.gethostname(), "process": os.getpid()}) + "\n"


def often_killed(starts: list[dict[str, Any]]) -> str:
    """What is said of a task at which processes end."""
    places = sorted({line["host"] for line in starts})
    return (
        f"its process ended {len(starts)} times before it was done (on {', '.join(places)}), which often"
        " means that memory ran out; try fewer workers, or a smaller picture"
    )


def read_journal(path: Path) -> list[dict[str, Any]]:
    """The lines of a journal; a line that was cut short is left out."""
    found = []
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        return []
    for line in text.splitlines():
        with suppress(ValueError):
            found.append(json.loads(line))
    return found


@contextmanager
def finished_folder(journal: Journal, name: str, parent: Path | None = None) -> Iterator[Path]:
    """A temporary folder that becomes the folder `name` with its journal, at once, when the block ends well.

    Args:
        journal: of the run.
        name: of the task and of its folder.
        parent: an existing folder for it; the run's own by default.
    """
    target = (parent or journal.folder) / name
    with whole_folder(target) as stage:
        yield stage
        before = target / JOURNAL
        earlier = before.read_text(encoding="utf-8") if before.exists() else ""
        (stage / JOURNAL).write_text(journal.finish(name, earlier), encoding="utf-8")
