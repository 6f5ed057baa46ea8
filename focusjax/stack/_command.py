"""The `focusjax stack` command."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from focusjax._console import say, warnings_printed
from focusjax._options import JobsOption, SchedulerOption
from focusjax.config import ConfigError, load_config
from focusjax.many import chosen_workers, failures
from focusjax.report import metres
from focusjax.stack._plan import StackPlan
from focusjax.stack._run import take_stack


def command(
    config: Annotated[Path, typer.Argument(help="A TOML file.", metavar="CONFIG")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the results; out/<config's name> by default.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the config.")
    ] = None,
    root: Annotated[
        Path | None, typer.Option("--root", metavar="DIR", help="Folder below which a config may name files.")
    ] = None,
    f_number: Annotated[
        float | None,
        typer.Option("--f-number", help="Of all shots; left out, the widest that takes no more shots."),
    ] = None,
    plan_only: Annotated[bool, typer.Option("--plan-only", help="Make the table and no pictures.")] = False,
    jobs: JobsOption = 1,
    scheduler: SchedulerOption = None,
) -> None:
    """Plan the fewest shots that make every sharp wish sharp in one of them, take them, and merge them."""
    console, errors = Console(), Console(stderr=True)
    folder = out if out is not None else Path("out") / config.stem
    with failures(errors, ConfigError, go_on="the same command begins anew"):
        read = load_config(config, set_ or (), root=root)
        workers = chosen_workers(errors, jobs, scheduler)
        with warnings_printed(errors):
            plan = take_stack(
                read,
                folder,
                f_number=f_number,
                rendering=not plan_only,
                workers=workers,
                on_note=lambda text: say(errors, f"Note: {text}"),
            )
    _print_plan(console, plan)
    say(console, f"Table: {folder / 'stack.csv'}")
    if not plan_only:
        say(console, f"Picture: {folder / 'merged.png'}")


def _print_plan(console: Console, plan: StackPlan) -> None:
    shown = Table("Shot", "Focus", "Sharp from", "to", "Overlap, 1/m", "Wishes", box=None)
    for number, (shot, overlap) in enumerate(zip(plan.shots, (*plan.overlaps(), None), strict=True), start=1):
        apart = "" if overlap is None else f"{overlap:.3g}"
        ends = (metres(shot.focus_distance), metres(shot.near), metres(shot.far))
        shown.add_row(str(number), *ends, apart, ", ".join(shot.names))
    console.print(shown)
    say(
        console,
        f"{len(plan.shots)} shot{'s' if len(plan.shots) > 1 else ''} at f/{plan.f_number:.2g}, circle of"
        f" confusion {plan.circle_px:.2g} px, hyperfocal distance {metres(plan.hyperfocal)}",
    )
    say(
        console,
        f"Worst blur {max(plan.worst_px.values()):.2f} px; one shot at f/{plan.single_f_number:.2g} has"
        f" {max(plan.single_px.values()):.2f} px",
    )
