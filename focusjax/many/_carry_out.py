"""Tasks from the first to the last, in this process, in an executor's, or on a cluster."""

import concurrent.futures
import signal
import threading
import uuid
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, Union

from focusjax.many._groups import Waiting
from focusjax.many._journal import Journal
from focusjax.many._task import Ended, ManyError, Task, sentence
from focusjax.many._worker import Work, attempt

if TYPE_CHECKING:
    from distributed import Client

Workers: TypeAlias = Union[int, str, Path, concurrent.futures.Executor, "Client"]
"""Who does the work: so many processes of this machine, a Dask scheduler's address or its scheduler file, an
executor, or a client of Dask."""

Stop = Callable[[], bool]
"""Whether no more tasks are to be started."""


def carry_out(
    work: Work,
    tasks: Sequence[Task],
    folder: Path,
    *,
    workers: Workers = 1,
    on_note: Callable[[str], None] | None = None,
) -> Generator[Ended]:
    """Do all `tasks`; each with what came of it, in the order they end.

    A task that raises fails alone. A process that ends takes nothing with it: what it was at is done again by
    another, and fails when three processes ended at it. After an interrupt (Ctrl-C) tasks that are under way
    are still finished, and then KeyboardInterrupt is raised; a second one ends at once.

    Args:
        work: does one task, in another process if need be: a function of a module, or an object that pickle
            takes. It sees to it that what it leaves behind appears all at once, and is left alone if it is
            there already: a task may be begun again though it was finished, when word of that was lost.
        tasks: with names of their own.
        folder: of the run; it exists, and all workers see it. Histories of tasks under way are in it.
        workers: who does it. One process means this one; with an executor, tasks whose process ends fail.
        on_note: called with a sentence on what a user should know.

    Raises:
        ManyError: workers that cannot be reached, have other versions or do not see the folder, before any
            task is begun; or a scheduler that is lost.

    Example:
        >>> import tempfile
        >>> def double(task, journal):
        ...     return 2 * task.argument
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     tasks = [Task(str(number), number) for number in range(3)]
        ...     print([ended.value for ended in carry_out(double, tasks, Path(folder))])
        [0, 2, 4]
    """
    _check_count(workers)
    note = on_note or _silent
    if not tasks:
        return
    journal = Journal(folder.resolve(), uuid.uuid4().hex[:12])
    with _interrupts(note) as stop, closing(_ended(work, tasks, journal, workers, stop, note)) as ended:
        journal.open()
        try:
            yield from ended
        finally:
            journal.close()
    if stop():
        raise KeyboardInterrupt


def check_workers(workers: Workers, folder: Path) -> None:
    """Refuse workers that `carry_out` would refuse, before other work is done.

    Args:
        workers: see `carry_out`.
        folder: of the run; one that is not there is made, unless the workers are refused.

    Raises:
        ManyError: see `carry_out`; or a folder that cannot be made.
    """
    _check_count(workers)
    if isinstance(workers, str | Path):
        from focusjax.many._cluster import connected

        new = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ManyError(
                f"folder {folder} cannot be used ({error.strerror}); choose another with --out"
            ) from None
        try:
            with connected(workers, 1, folder.resolve()):
                pass
        except ManyError:
            if new:
                with suppress(OSError):
                    folder.rmdir()
            raise


def _check_count(workers: Workers) -> None:
    if isinstance(workers, int) and workers < 1:
        raise ManyError(f"jobs is {workers}; expected at least 1 process")


def _ended(
    work: Work,
    tasks: Sequence[Task],
    journal: Journal,
    workers: Workers,
    stop: Stop,
    note: Callable[[str], None],
) -> Generator[Ended]:
    if workers == 1:
        for task in tasks:
            if stop():
                return
            yield attempt(work, task, journal)
    elif isinstance(workers, concurrent.futures.Executor):
        yield from _in_executor(workers, work, tasks, journal, stop)
    else:
        # It takes half a second to import.
        from focusjax.many._cluster import connected
        from focusjax.many._dispatch import dispatch

        with connected(workers, len(tasks), journal.folder) as client:
            yield from dispatch(client, work, Waiting(tasks), journal, stop, note)


def _in_executor(
    executor: concurrent.futures.Executor, work: Work, tasks: Sequence[Task], journal: Journal, stop: Stop
) -> Iterator[Ended]:
    futures = {executor.submit(attempt, work, task, journal): task for task in tasks}
    try:
        for future in concurrent.futures.as_completed(futures):
            try:
                yield future.result()
            except concurrent.futures.CancelledError:
                continue
            except Exception as error:
                yield Ended(futures[future], error=sentence(error))
            if stop():
                _cancel(futures)
    finally:
        _cancel(futures)


def _cancel(futures: dict[concurrent.futures.Future[Ended], Task]) -> None:
    """Those that are not begun are never begun."""
    for future in futures:
        future.cancel()


@contextmanager
def _interrupts(note: Callable[[str], None]) -> Iterator[Stop]:
    """Within, the first interrupt is noted and the second one raises, where interrupts can be caught."""
    stopping = threading.Event()
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is not signal.default_int_handler:
        # Somebody else handles them, or they arrive elsewhere.
        yield stopping.is_set
        return

    def interrupted(number: int, frame: object) -> None:
        if stopping.is_set():
            raise KeyboardInterrupt
        stopping.set()
        note("stopping when what is under way is finished; interrupt again to end at once")

    signal.signal(signal.SIGINT, interrupted)
    try:
        yield stopping.is_set
    finally:
        signal.signal(signal.SIGINT, before)


def _silent(_: str) -> None:
    """Ignore a note."""
