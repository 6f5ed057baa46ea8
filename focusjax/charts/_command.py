"""The `focusjax lens` command."""

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from focusjax.charts._beams import film_at, largest_field
from focusjax.charts._figures import cross_section, curves, highlights, spots
from focusjax.io import staged_folder
from focusjax.optics import (
    PRESETS,
    Prescription,
    first_order,
    lens_preset,
    load_lens,
    opened_to,
    seidel_sums,
    with_focal_length,
)

FILES = ("section.png", "spots.png", "highlights.png", "curves.png", "lens.json")
"""Every file that the command leaves in its folder."""
_FAILED, _BAD_INPUT = 1, 2


def command(
    lens: Annotated[
        str, typer.Argument(help=f"A lens file (.dat, .zmx, .json), or one of {', '.join(PRESETS)}.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the charts; out/<lens's name> by default.")
    ] = None,
    focal_length: Annotated[
        float | None, typer.Option("--focal-length", help="Scale the lens to so many millimetres.")
    ] = None,
    f_number: Annotated[float | None, typer.Option("--f-number", help="Close the stop to this.")] = None,
) -> None:
    """Draw a real lens: cross-section, spots, highlights, focus and distortion; list its first-order data."""
    console, errors = Console(), Console(stderr=True)
    try:
        chosen = lens_preset(lens) if lens in PRESETS or not Path(lens).suffix else load_lens(lens)
        if focal_length is not None:
            chosen = with_focal_length(chosen, focal_length)
        if f_number is not None:
            chosen = opened_to(chosen, f_number)
    except ValueError as error:
        _fail(errors, error, _BAD_INPUT)
    folder = out if out is not None else Path("out") / Path(lens).stem
    try:
        facts = draw_lens(chosen, folder)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        _fail(errors, error, _FAILED)
    except Exception as error:
        _fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), _FAILED)
    table = Table(title=chosen.name, show_header=False)
    for name, value in {**facts["first_order"], **facts["wavefront_mm"]}.items():
        table.add_row(name.replace("_", " "), f"{value:.5g}")
    console.print(table)
    console.print(f"Charts: {folder}", soft_wrap=True, highlight=False)


def draw_lens(lens: Prescription, folder: Path) -> dict:
    """Draw the charts of `lens` into `folder` and return what `lens.json` holds.

    First-order data are millimetres from the first vertex (front), from the last (back, rear, exit pupil);
    the wavefront's Seidel coefficients are for the largest field, in mm.

    Raises:
        ValueError: a lens that forms no real images, or a folder that cannot be written.
    """
    # Refuses what has no film before anything is drawn.
    with_focal_length(lens, 1.0)
    film, field = film_at(lens), largest_field(lens)
    sums = seidel_sums(lens, field=field)
    seen = first_order(lens)
    facts = {
        "name": lens.name,
        "field_deg": float(np.degrees(field)),
        "film_behind_last_vertex": film - float(lens.vertices()[-1]),
        "first_order": {name: float(value) for name, value in vars(seen).items()},
        "wavefront_mm": {name: float(value) for name, value in sums.wavefront().items()},
        "seidel_mm": {name: np.asarray(value).tolist() for name, value in vars(sums).items()},
    }
    with staged_folder(folder, owned=FILES) as stage:
        cross_section(stage / "section.png", lens, film, field)
        spots(stage / "spots.png", lens, film, field)
        highlights(stage / "highlights.png", lens, field)
        curves(stage / "curves.png", lens, film, field)
        (stage / "lens.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    return facts


def _fail(console: Console, error: BaseException, status: int) -> None:
    text = " ".join(str(error).split())
    console.print(f"focusjax: {text}", soft_wrap=True, highlight=False, markup=False)
    raise typer.Exit(status)
