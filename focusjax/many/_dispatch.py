"""Tasks given to the workers of a Dask cluster, a few ahead, and done again where a worker ends."""

import concurrent.futures
import queue
import time
from collections import Counter
from collections.abc import Callable, Container, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import distributed

from focusjax.many._cluster import address_of, complaints
from focusjax.many._groups import Waiting
from focusjax.many._journal import Journal
from focusjax.many._task import Ended, ManyError, Task, sentence
from focusjax.many._worker import Work, attempt

_AHEAD = 2
"""Tasks that a worker has at most, so that it never waits; the rest wait here, and not in the scheduler."""
_ANSWER = 5.0
"""Seconds that a worker has to send what came of a task that it has finished."""
_LOOK = 1.0
"""Seconds after which the workers are counted again."""


@dataclass
class _AtWork:
    """What the workers are at.

    Attributes:
        tasks: task and worker of every future.
        groups: of each worker's last task.
        known: workers that were looked at, and whether they can be used.
        started: how many tasks were given to workers.
    """

    tasks: dict[distributed.Future, tuple[Task, str]] = field(default_factory=dict)
    groups: dict[str, str] = field(default_factory=dict)
    known: dict[str, bool] = field(default_factory=dict)
    started: int = 0

    def lost(self, client: distributed.Client, workers: Container[str]) -> list[Task]:
        """The tasks of workers that are gone, which are no longer at work."""
        gone = [
            future
            for future, (_, worker) in self.tasks.items()
            if worker not in workers and future.status == "pending"
        ]
        self.groups = {worker: group for worker, group in self.groups.items() if worker in workers}
        client.cancel(gone)
        return [self.tasks.pop(future)[0] for future in gone]


def dispatch(
    client: distributed.Client,
    work: Work,
    waiting: Waiting,
    journal: Journal,
    stop: Callable[[], bool],
    note: Callable[[str], None],
) -> Generator[Ended]:
    """Do the tasks that wait; each with what came of it.

    The scheduler holds no more than a few tasks for each worker, however many there are. What a worker was
    at that is gone goes to another; the journal counts how often a task was begun, and fails it in the end.

    Raises:
        ManyError: the scheduler is lost.
    """
    ended: queue.SimpleQueue[distributed.Future] = queue.SimpleQueue()
    now, looked, workers = _AtWork(), -_LOOK, set[str]()
    address = address_of(client)
    try:
        while now.tasks or (waiting and not stop()):
            if client.status != "running":
                raise ManyError(
                    f"the scheduler at {address} is gone; start it again and give the same command, a batch"
                    " or a data set with --resume, which keeps what is done"
                )
            if time.monotonic() - looked > _LOOK:
                before, looked = workers, time.monotonic()
                try:
                    workers = _usable(client, now, journal, note)
                except OSError:
                    # The scheduler is about to be found gone, or answers the next time.
                    continue
                waiting.put_back(now.lost(client, workers))
                if before and not workers and client.status == "running":
                    note("no workers are left; waiting for others")
            if not stop():
                _give(client, work, waiting, journal, now, workers, ended)
            for future in _some(ended):
                task = now.tasks.pop(future, (None, ""))[0]
                if task is not None:
                    yield from _result(future, task, waiting)
    finally:
        if client.status == "running":
            client.cancel(list(now.tasks))


def _give(
    client: distributed.Client,
    work: Work,
    waiting: Waiting,
    journal: Journal,
    now: _AtWork,
    workers: Iterable[str],
    ended: "queue.SimpleQueue[distributed.Future]",
) -> None:
    """Tasks for the workers that have few."""
    loads = Counter(worker for _, worker in now.tasks.values())
    for ahead in range(1, _AHEAD + 1):
        for worker in workers:
            # Towards the end nobody has a second task that another could begin.
            if not waiting or loads[worker] >= ahead or (ahead > 1 and len(waiting) < len(loads)):
                continue
            others = (group for other, group in now.groups.items() if other != worker)
            task = waiting.take(now.groups.get(worker), others)
            key = f"focusjax-{journal.run}-{now.started}"
            future = client.submit(attempt, work, task, journal, key=key, workers=[worker], pure=False)
            now.started += 1
            now.tasks[future], now.groups[worker] = (task, worker), task.group
            loads[worker] += 1
            future.add_done_callback(ended.put)


def _usable(
    client: distributed.Client, now: _AtWork, journal: Journal, note: Callable[[str], None]
) -> set[str]:
    """The addresses of the workers that are there, but for those that joined and cannot be used."""
    threads: Any = client.nthreads()
    there = set(threads)
    joined = there.difference(now.known)
    if joined and not now.known:
        # All were looked at before the first task was given.
        now.known.update(dict.fromkeys(joined, True))
    elif joined:
        try:
            found = complaints(client, journal.folder, joined)
        except ManyError as error:
            found = dict.fromkeys(joined, str(error))
        for complaint in dict.fromkeys(found.values()):
            note(f"{complaint}; until then nothing is done there")
        now.known.update({address: address not in found for address in joined})
    return {address for address in there if now.known[address]}


def _some(ended: "queue.SimpleQueue[distributed.Future]") -> list[distributed.Future]:
    """What has ended by now; waits a little for the first."""
    futures: list[distributed.Future] = []
    with suppress(queue.Empty):
        futures.append(ended.get(timeout=_LOOK / 2))
        while True:
            futures.append(ended.get_nowait())
    return futures


def _result(future: distributed.Future, task: Task, waiting: Waiting) -> Iterator[Ended]:
    """What came of a task; nothing where it has to be done again."""
    try:
        yield future.result(timeout=_ANSWER)
    except (concurrent.futures.CancelledError, distributed.KilledWorker, OSError):
        # What a task raises comes back as a value. So the scheduler is gone, or the worker, or the connection
        # to it, with what it found out; what is finished is not done again.
        future.cancel()
        waiting.put_back([task])
    except Exception as error:
        yield Ended(task, error=sentence(error), log=repr(error))
