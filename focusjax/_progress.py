"""How far a command is: a bar on a terminal, plain lines elsewhere."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.text import Text

from focusjax import job
from focusjax._console import Talk, say

STAGES = {
    "load": "Loading meshes",
    "locate": "Finding focus points",
    "locate_again": "Finding depths",
    "solve": "Solving",
    "peel": "Peeling layers",
    "plan": "Planning rays",
    "render": "Tracing rays",
    "examine": "Examining the picture",
    "guess": "Counting what was guessed",
    "pinhole": "Sharp view",
    "develop": "Developing",
    "expose": "Adding frames up",
    "film": "Writing the film",
    "save": "Writing files",
}
"""What people read of the stages of a run."""
_PAUSE = 10.0
"""Seconds between two lines about one stage."""


@contextmanager
def progress(console: Console, talk: Talk = Talk.NORMAL) -> Iterator[job.Progress]:
    """A callback that shows the stages, and the share of them that is done, on `console`.

    On a terminal it is a bar with the time left, which is gone at the end; elsewhere a line for each stage,
    and one every ten seconds of those that know how far they are.

    Args:
        console: where.
        talk: nothing when quiet; a line for each stage with its seconds when verbose, on a terminal as well.
    """
    if talk is Talk.QUIET:
        yield lambda stage, share: None
        return
    if not console.is_terminal:
        lines = _Lines(console, timed=talk is Talk.VERBOSE)
        yield lines.report
        lines.end()
        return
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        _TimeLeft(),
        console=console,
        transient=True,
    )
    task = bar.add_task("Starting", total=None)
    lines = _Lines(console, timed=True) if talk is Talk.VERBOSE else None
    current = None

    def report(stage: str, share: float | None) -> None:
        nonlocal current
        if stage != current:
            bar.reset(task, total=None, description=STAGES.get(stage, stage))
            current = stage
        if share is not None:
            bar.update(task, total=1.0, completed=min(share, 1.0))
        if lines is not None:
            lines.report(stage, None)

    try:
        bar.start()
        yield report
        if lines is not None:
            lines.end()
    finally:
        bar.stop()


class _TimeLeft(ProgressColumn):
    """How long a stage goes on if it goes on as it has, or how long it has taken so far."""

    max_refresh = 0.5

    def render(self, task: Task) -> Text:
        if task.time_remaining is not None and not task.finished:
            return Text(f"{_clock(task.time_remaining)} left", "progress.remaining")
        return Text(_clock(task.elapsed or 0.0), "progress.elapsed")


class _Lines:
    """A line for each stage: as it begins, or with its seconds when it has ended."""

    def __init__(self, console: Console, *, timed: bool):
        self._console, self._timed = console, timed
        self._stage: str | None = None
        self._began = self._said = time.monotonic()

    def report(self, stage: str, share: float | None) -> None:
        now = time.monotonic()
        if stage != self._stage:
            self.end()
            self._stage, self._began, self._said = stage, now, now
            if not self._timed:
                say(self._console, self._name())
        elif share and now - self._said >= _PAUSE:
            self._said = now
            left = (now - self._began) * (1.0 - min(share, 1.0)) / share
            say(self._console, f"{self._name()}: {100 * share:.0f} %, {_clock(left)} left")

    def end(self) -> None:
        """The stage is over."""
        if self._timed and self._stage is not None:
            say(self._console, f"{self._name()}: {time.monotonic() - self._began:.1f} s")
        self._stage = None

    def _name(self) -> str:
        return STAGES.get(self._stage or "", self._stage or "")


def _clock(seconds: float) -> str:
    """Minutes and seconds, as 1:05."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
