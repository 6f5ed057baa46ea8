"""A batch from its items to its summary."""

import dataclasses
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from focusjax.batch._errors import BatchError
from focusjax.batch._fingerprint import Fingerprints, changed_since
from focusjax.batch._folder import LOG_FILE, Existing, batch_folder, done_before
from focusjax.batch._items import Item
from focusjax.batch._results import BatchResults, ItemResult, result_of
from focusjax.batch._summary import save_summary
from focusjax.batch._work import DoItem, task_of
from focusjax.many import Ended, Task, Workers, carry_out, check_workers

_SUMMARY_SHARE = 0.02
"""Of the time, at most, goes into summaries; there may be thousands of items."""


def run_batch(
    items: Sequence[Item],
    folder: Path | str,
    *,
    workers: Workers = 1,
    existing: Existing = "refuse",
    solve_only: bool = False,
    on_result: Callable[[ItemResult], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> BatchResults:
    """Do all `items`, each into a folder of its name, and write a summary.

    An item's folder is what `focusjax run` leaves, with `thumbnail.jpg` and `item.json`. It appears whole
    or not at all, so that a batch that is killed loses nothing that is finished, and `existing="resume"`
    goes on with it, with any workers. An item that fails does not stop the others; its folder has
    `failed.log`, and it is tried again then. The summary (`summary.csv`, `summary.json`, `summary.html`)
    is written as items finish, and lists them all.

    Args:
        items: from `make_items` or `items_from_file`.
        folder: made if need be.
        workers: who shares the work: so many processes of this machine, the address or the scheduler file of
            a Dask cluster, a `distributed.Client`, or a `concurrent.futures.Executor`. With 1, everything
            is done in this process, so that an item that takes the process down takes the batch with it;
            of several processes, an item at which three have ended fails alone. Scripts that use several
            have to call this under `if __name__ == "__main__":`. The folder is one that all workers see.
        existing: what to do about results that are there: "refuse" them; "resume", which keeps those whose
            config and files are what they were, and does the others; "overwrite", which removes them.
        solve_only: find the settings and make no pictures.
        on_result: called with each item's result, those kept from before first.
        on_note: called with a sentence on each item that is done again, and why.

    Raises:
        BatchError: no items, or a folder that cannot be used; nothing was started.
        ManyError: workers that cannot be used; nothing was started. Or workers that are lost.
    """
    folder = Path(folder)
    if not items:
        raise BatchError("there are no items; give at least one config")
    check_workers(workers, folder)
    with batch_folder(folder, [item.name for item in items], existing):
        note = on_note or _silent
        batch = _Batch(items, folder, solve_only, on_result or _silent)
        tasks = batch.sort_out(note)
        try:
            # Closed, so that no process is left at work when something goes wrong here.
            work = DoItem(folder.absolute(), solve_only)
            with closing(carry_out(work, tasks, folder, workers=workers, on_note=on_note)) as ended:
                for each in ended:
                    batch.note(each)
        finally:
            batch.finish(note)
    return batch.so_far()


class _Batch:
    """The results so far, which are saved as they come, or soon after where they come in quick succession."""

    def __init__(
        self, items: Sequence[Item], folder: Path, solve_only: bool, on_result: Callable[[ItemResult], None]
    ):
        self._items = items
        self._folder = folder
        self._solve_only = solve_only
        self._on_result = on_result
        self._results = {item.name: ItemResult(item, "waiting") for item in items}
        self._not_before = 0.0
        self._saving = threading.Lock()
        self._later: threading.Timer | None = None

    def sort_out(self, on_note: Callable[[str], None]) -> list[Task]:
        """What is left to do; what is done already counts as results."""
        fingerprints, tasks = Fingerprints(), []
        for item in self._items:
            fingerprint = fingerprints.of(item.config, solve_only=self._solve_only)
            before = done_before(self._folder / item.name)
            change = "" if before is None else changed_since(before.get("fingerprint", {}), fingerprint)
            if before is not None and not change:
                self._add(result_of(item, self._folder, kept=True))
                continue
            tasks.append(task_of(dataclasses.replace(item, config=item.config.anywhere()), fingerprint))
            if change:
                on_note(f"{item.name} is done again: {change}")
        return tasks

    def note(self, ended: Ended) -> None:
        """An item has ended."""
        item = self._results[ended.task.name].item
        if ended.error:
            # A disk that is full fails items, not the batch.
            with suppress(OSError):
                (self._folder / item.name).mkdir(exist_ok=True)
                (self._folder / item.name / LOG_FILE).write_text(f"{ended.error}\n\n{ended.log}")
            self._add(ItemResult(item, "failed", ended.error))
        else:
            self._add(result_of(item, self._folder, kept=False))
        wait = self._not_before - time.monotonic()
        if wait <= 0.0:
            self._save_meanwhile()
        elif self._later is None:
            # The next item may take long, and the summary does not wait for it.
            self._later = threading.Timer(wait, self._save_meanwhile)
            self._later.daemon = True
            self._later.start()

    def finish(self, on_note: Callable[[str], None]) -> None:
        """Write the summary for the last time."""
        later = self._later
        if later is not None and later.is_alive():
            later.cancel()
            later.join()
        try:
            self._save()
        except OSError as error:
            on_note(f"the summary could not be written ({error.strerror}); with room for it, --resume does")

    def _save_meanwhile(self) -> None:
        # Before results are looked at: of what is noted from now on another timer takes care.
        self._later = None
        # What hinders it is noted when the summary is written for the last time, if it still does then.
        with suppress(OSError):
            self._save()

    def _save(self) -> None:
        with self._saving:
            start = time.monotonic()
            save_summary(self.so_far())
            end = time.monotonic()
            self._not_before = end + (end - start) / _SUMMARY_SHARE

    def so_far(self) -> BatchResults:
        """All results."""
        return BatchResults(self._folder, self._solve_only, tuple(self._results.values()))

    def _add(self, result: ItemResult) -> None:
        self._results[result.item.name] = result
        self._on_result(result)


def _silent(_: Any) -> None:
    """Ignore a result or a note."""
