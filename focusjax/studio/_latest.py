"""A thread that works on the latest request only."""

import threading
from collections.abc import Callable

from focusjax._console import sentence

Cancelled = Callable[[], bool]
"""Says whether a newer request has come."""
Work = Callable[[Cancelled], None]


_KNOWN = (ValueError, RuntimeError, OSError, MemoryError)


def what_failed(error: Exception) -> str:
    """What work raised, in a sentence; errors that nobody foresaw say that they are ours."""
    if isinstance(error, _KNOWN):
        return sentence(error)
    return f"internal error, please report it: {error!r}"


class Latest:
    """Does one piece of work at a time, in a thread of its own; those that newer ones overtake are not begun.

    Work that has begun goes on until it looks at what it is given: whether something newer waits.
    """

    def __init__(self, name: str, on_error: Callable[[Exception], None]):
        """Start the thread.

        Args:
            name: of the thread.
            on_error: called with the exception that work raises.
        """
        self._condition = threading.Condition()
        self._waiting: Work | None = None
        self._busy = False
        self._newest = 0
        self._closed = False
        self._on_error = on_error
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, work: Work) -> None:
        """Do `work` next; drop what waits, and mark what has begun as overtaken."""
        self._replace(work)

    def cancel(self) -> None:
        """Drop what waits, and mark what has begun as overtaken."""
        self._replace(None)

    def overtaken(self, cancelled: Cancelled, seconds: float) -> bool:
        """Wait for something newer, for so long at most; whether it has come. For the work itself to ask."""
        with self._condition:
            return self._condition.wait_for(cancelled, seconds)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until nothing is left to do; whether that came within `seconds`."""
        with self._condition:
            return self._condition.wait_for(lambda: self._waiting is None and not self._busy, seconds)

    def close(self) -> None:
        """End the thread after what it has begun."""
        with self._condition:
            self._closed = True
            self._replace(None)
        self._thread.join()

    def _replace(self, work: Work | None) -> None:
        with self._condition:
            self._waiting = work
            self._newest += 1
            self._condition.notify_all()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._waiting is not None or self._closed)
                if self._closed:
                    return
                work, mine = self._waiting, self._newest
                self._waiting, self._busy = None, True
            assert work is not None
            try:
                work(lambda mine=mine: self._newest != mine)
            except Exception as error:
                self._on_error(error)
            with self._condition:
                self._busy = False
                self._condition.notify_all()
