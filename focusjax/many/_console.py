"""What commands that do many things have in common: their options, and how far they are."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from focusjax._console import BAD_INPUT, FAILED, INTERRUPTED, fail, say
from focusjax._parallel import CORES
from focusjax.many._task import ManyError, sentence


def chosen_workers(errors: Console, jobs: int, scheduler: str | None) -> int | str:
    """Who does the work, of the two options; a note where there are more processes than cores.

    Raises:
        ManyError: both are given.
    """
    if scheduler is not None and jobs != 1:
        raise ManyError(f"--scheduler {scheduler} has workers of its own; leave out --jobs {jobs}")
    if jobs > CORES:
        say(errors, f"Note: {jobs} jobs on {CORES} cores only take memory; {CORES} or fewer are as fast")
    return jobs if scheduler is None else scheduler


@contextmanager
def failures(errors: Console, *refusals: type[Exception], go_on: str) -> Iterator[None]:
    """Whatever is raised within becomes a sentence and an exit status.

    Args:
        errors: where the sentence goes.
        refusals: what is raised before anything is started, beside `ManyError`.
        go_on: how to go on after an interrupt.
    """
    try:
        yield
    except (ManyError, *refusals) as error:
        fail(errors, error, BAD_INPUT)
    except KeyboardInterrupt:
        fail(errors, RuntimeError(f"interrupted; {go_on}"), INTERRUPTED)
    except Exception as error:
        fail(errors, RuntimeError(sentence(error)), FAILED)


class _Rate(ProgressColumn):
    """Steps per minute."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{60 * speed:.3g}/min")


def progress_bar(console: Console) -> Progress:
    """How many are done, how quickly, and the time left; nothing where output goes to a file."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
