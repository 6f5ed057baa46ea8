"""How far a command is."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from focusjax import job

_STAGES = {
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


@contextmanager
def progress(console: Console) -> Iterator[job.Progress]:
    """A progress bar on a terminal, gone when the run ends; nothing where output goes to a file."""
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    task = bar.add_task("Starting", total=None)
    current = None

    def tell(stage: str, share: float | None) -> None:
        nonlocal current
        if stage != current:
            bar.reset(task, total=None, description=_STAGES.get(stage, stage))
            current = stage
        if share is not None:
            bar.update(task, total=1.0, completed=min(share, 1.0))

    try:
        bar.start()
        yield tell
    finally:
        bar.stop()
