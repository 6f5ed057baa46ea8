"""The `focusjax batch` command."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from focusjax._console import FAILED, say
from focusjax._options import JobsOption, SchedulerOption
from focusjax.batch._description import is_batch_file, items_from_file
from focusjax.batch._errors import BatchError
from focusjax.batch._folder import Existing
from focusjax.batch._grid import parse_grid
from focusjax.batch._items import Item, make_items
from focusjax.batch._results import BatchResults, ItemResult
from focusjax.batch._run import run_batch
from focusjax.config import ConfigError
from focusjax.many import Workers, chosen_workers, failures, progress_bar
from focusjax.report import f_number, metres

_MANY = list[str] | None


def command(
    configs: Annotated[
        list[Path], typer.Argument(help=r"TOML files; or one with a \[batch] table.", metavar="CONFIG...")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for the results, a folder in it for each item.")],
    grid: Annotated[
        _MANY,
        typer.Option(
            "--grid",
            metavar="KEY=[VALUE,...]",
            help="Values of a key; repeated, all combinations are made.",
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(
            "--table", metavar="CSV", help="A row for each item; columns are keys, and perhaps name."
        ),
    ] = None,
    set_: Annotated[
        _MANY, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of all configs.")
    ] = None,
    root: Annotated[
        Path | None,
        typer.Option(
            "--root", metavar="DIR", help="Folder below which configs may name files; their own by default."
        ),
    ] = None,
    jobs: JobsOption = 1,
    scheduler: SchedulerOption = None,
    solve_only: Annotated[
        bool, typer.Option("--solve-only", help="Solve for the lens settings and make no pictures.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep what is done already, if nothing about it has changed.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Remove what earlier batches left.")] = False,
) -> None:
    """Solve and render many configs, or one with many settings.

    Exits with 0 when all items are done, 1 when some failed, and 2, before anything is started, when
    something about the batch is wrong.
    """
    console, errors = Console(), Console(stderr=True)
    with failures(errors, ConfigError, BatchError, go_on="--resume goes on with what is not done"):
        items = _items(configs, grid or [], table, set_ or [], root)
        workers = chosen_workers(errors, jobs, scheduler)
        results = _run(console, errors, items, out, workers, _existing(resume, overwrite), solve_only)
    _conclude(console, errors, results)


def _items(
    configs: list[Path], grid: list[str], table: Path | None, overrides: list[str], root: Path | None
) -> list[Item]:
    described = [path for path in configs if is_batch_file(path)]
    if not described:
        return make_items(configs, grid=parse_grid(grid), table=table, overrides=overrides, root=root)
    if len(configs) > 1 or grid or table is not None:
        raise BatchError(
            f"{described[0]} has a [batch] table, which says it all; leave out --grid, --table and other"
            " configs"
        )
    return items_from_file(described[0], tuple(overrides), root=root)


def _existing(resume: bool, overwrite: bool) -> Existing:
    if resume and overwrite:
        raise BatchError("--resume keeps what is there and --overwrite removes it; give one of them")
    return "resume" if resume else "overwrite" if overwrite else "refuse"


def _run(
    console: Console,
    errors: Console,
    items: list[Item],
    out: Path,
    workers: Workers,
    existing: Existing,
    solve_only: bool,
) -> BatchResults:
    """Run the batch; a line for each item, and a bar below them on a terminal."""
    bar = progress_bar(console)
    # On a terminal, lines from elsewhere would break the bar.
    aside = console if console.is_terminal and errors.is_terminal else errors
    with bar:
        task = bar.add_task("Solving" if solve_only else "Solving and rendering", total=len(items))

        def report(result: ItemResult) -> None:
            bar.advance(task)
            for warning in result.facts.get("warnings") or ():
                say(aside, f"Warning: {result.item.name}: {warning}")
            say(console, _line(result))

        def note(text: str) -> None:
            say(aside, f"Note: {text}")

        return run_batch(
            items,
            out,
            workers=workers,
            existing=existing,
            solve_only=solve_only,
            on_result=report,
            on_note=note,
        )


def _line(result: ItemResult) -> str:
    """What came of an item, on one line."""
    name = result.item.name
    if result.status == "failed":
        return f"{name}  failed: {result.message}"
    lens = result.facts["lens"]
    parts = [f"focus {metres(lens['focus_distance_m'])}", f_number(lens["f_number"])]
    if result.counted:
        parts.append(f"{result.wishes_met} of {len(result.counted)} wishes met")
        parts.append(f"worst miss {result.worst_error:.2f} px")
    parts.append("kept" if result.kept else f"{result.facts['seconds']:.1f} s")
    return f"{name}  {', '.join(parts)}"


def _conclude(console: Console, errors: Console, results: BatchResults) -> None:
    """The last lines, and the exit status."""
    done = results.having("done")
    kept = sum(result.kept for result in done)
    counts = f"{len(done)} of {len(results.results)} done"
    say(console, counts + (f", {kept} of them before" if kept else ""))
    say(console, f"Summary: {results.folder / 'summary.html'}")
    for result in results.failed:
        say(errors, f"focusjax: {result.item.name} failed: {result.message}")
    if results.failed:
        raise typer.Exit(FAILED)
