"""The `focusjax dataset` command."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from focusjax._console import FAILED, say, warnings_printed
from focusjax._options import JobsOption, SchedulerOption
from focusjax.config import ConfigError
from focusjax.dataset._run import make_dataset
from focusjax.dataset._spec import load_spec
from focusjax.many import chosen_workers, failures, progress_bar

_SHOWN = 10


def command(
    spec: Annotated[Path, typer.Argument(help="A TOML file that says what is drawn.", metavar="SPEC")],
    count: Annotated[int, typer.Option("--count", help="Number of pictures.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the data set.")],
    root: Annotated[
        Path | None, typer.Option("--root", metavar="DIR", help="Folder below which the meshes may lie.")
    ] = None,
    jobs: JobsOption = 1,
    scheduler: SchedulerOption = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the pictures that are there, and make the others.")
    ] = False,
) -> None:
    """Make random pictures with depth, blur and their sharp twins, to learn from.

    Exits with 0 when all pictures are there, 1 when some failed, and 2 when something is wrong before.
    """
    console, errors = Console(), Console(stderr=True)
    with failures(errors, ConfigError, go_on="--resume goes on with what is not done"):
        read = load_spec(spec, root=root)
        workers = chosen_workers(errors, jobs, scheduler)
        with progress_bar(console) as bar, warnings_printed(errors):
            task = bar.add_task("Making pictures", total=count)
            results = make_dataset(
                read,
                count,
                out,
                workers=workers,
                resume=resume,
                on_done=lambda number: bar.advance(task, number),
                on_note=lambda text: say(errors, f"Note: {text}"),
            )
    kept = f", {results.kept} of them before" if results.kept else ""
    say(console, f"{results.there} pictures{kept}")
    say(console, f"Manifest: {results.folder / 'manifest.jsonl'}")
    for text in results.failed[:_SHOWN]:
        say(errors, f"focusjax: {text}")
    if results.failed:
        raise typer.Exit(FAILED)
