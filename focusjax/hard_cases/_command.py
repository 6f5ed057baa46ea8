"""`focusjax bench hard-cases`: the table of all hard cases, as text, as CSV and as a page."""

import csv
import dataclasses
import itertools
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from focusjax._console import BAD_INPUT, FAILED, fail, say, warnings_printed
from focusjax._templates import template
from focusjax.hard_cases._check import Check
from focusjax.hard_cases._run import NAMES, hard_cases
from focusjax.io import staged_folder

FILES = ("hard_cases.html", "hard_cases.csv")
"""Every file that the command leaves in its folder."""


def command(
    out: Annotated[Path, typer.Option("--out", help="Folder for the page and the table.")] = Path(
        "out/hard_cases"
    ),
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="CASE", help="One case; may be repeated.")
    ] = None,
) -> None:
    """Check wishes, glass and pictures that are numerically hard, in both precisions, against the truth.

    The exit status is 1 if a bound is broken. It takes about half an hour, most of it compiling.
    """
    console, errors = Console(), Console(stderr=True)
    unknown = [name for name in only or () if name not in NAMES]
    if unknown:
        error = ValueError(f"--only is {unknown[0]!r}; expected one of {', '.join(NAMES)}")
        fail(errors, error, BAD_INPUT)
    try:
        with staged_folder(out, owned=FILES) as stage, warnings_printed(errors):
            with errors.status("Starting") as status:
                checks = hard_cases(only or NAMES, lambda name, share: status.update(Text(name)))
            save_checks(stage, checks)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED, out)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    console.print(_table(checks))
    say(console, f"Page: {out / 'hard_cases.html'}")
    broken = [check for check in checks if not check.kept]
    if broken:
        listed = "; ".join(f"{each.case}: {each.quantity}, {each.error:.2g}" for each in broken)
        fail(errors, ValueError(f"{len(broken)} of {len(checks)} bounds are broken: {listed}"), FAILED)


def save_checks(folder: Path, checks: list[Check]) -> None:
    """Write the checks as CSV, and as a page."""
    with (folder / "hard_cases.csv").open("w", newline="", encoding="utf-8") as stream:
        names = [field.name for field in dataclasses.fields(Check)]
        writer = csv.DictWriter(stream, [*names, "verdict"])
        writer.writeheader()
        writer.writerows({**dataclasses.asdict(check), "verdict": check.verdict} for check in checks)
    page = template("focusjax.hard_cases", "hard_cases.html.j2").render(
        cases=_by_case(checks), checks=checks, worst=_worst(checks)
    )
    (folder / "hard_cases.html").write_text(page, encoding="utf-8")


def _by_case(checks: list[Check]) -> list[tuple[str, str, list[Check]]]:
    """Group, name and checks of every case."""
    keyed = itertools.groupby(checks, lambda check: (check.group, check.case))
    return [(group, case, list(held)) for (group, case), held in keyed]


def _worst(checks: list[Check]) -> Check:
    """The check nearest to its bound, or beyond it farthest."""
    return max(checks, key=lambda check: check.share if check.finite else float("inf"))


def _table(checks: list[Check]) -> Table:
    """One line for every case: what of it is nearest to its bound, and the worst verdict."""
    table = Table()
    for title in ("", "case", "nearest to its bound", "error", "bound", ""):
        table.add_column(title, justify="right" if title in ("error", "bound") else "left")
    for group, case, held in _by_case(checks):
        worst = _worst(held)
        numbers = (f"{worst.error:.1e}", f"{worst.bound:.1e}")
        said = {check.verdict for check in held}
        verdict = next(each for each in ("not finite", "broken", "known defect", "kept") if each in said)
        table.add_row(group, Text(case), Text(worst.quantity), *numbers, verdict)
    return table
