"""A task, what came of it, and how an error becomes a sentence."""

from dataclasses import dataclass
from typing import Any

from focusjax import _console

_OURS = (ValueError, RuntimeError, OSError, MemoryError)


class ManyError(ValueError):
    """Workers that cannot be used, or are lost; the sentence says which, and how to go on."""


@dataclass(frozen=True)
class Task:
    """One thing to do, which a worker can do by itself.

    Attributes:
        name: no two tasks of a run have the same; good as a file's name.
        argument: what to do; goes to the worker by pickle, so it should be small.
        group: tasks of one group go to one worker, as far as no worker waits for that.
    """

    name: str
    argument: Any = None
    group: str = ""


@dataclass(frozen=True)
class Ended:
    """What came of a task.

    Attributes:
        task: what was to be done.
        value: what the work returned; None where it failed.
        error: what went wrong, a sentence; "" where nothing did.
        log: of a task that failed: traceback and history, for a file.
    """

    task: Task
    value: Any = None
    error: str = ""
    log: str = ""


def sentence(error: Exception) -> str:
    """The message of `error` for a person: its first paragraph, on one line."""
    if not isinstance(error, _OURS):
        return f"internal error, please report it: {error!r}"
    return _console.sentence(error)
