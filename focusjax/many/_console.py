"""What commands that do many things have in common: their options, and how far they are."""

from typing import Annotated

import typer
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

from focusjax._console import say
from focusjax._parallel import CORES
from focusjax.many._task import ManyError

JobsOption = Annotated[int, typer.Option("--jobs", help="Processes that share the work.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="A Dask scheduler whose workers share the work: tcp://HOST:PORT, or its scheduler file.",
    ),
]


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
