"""The `focusjax lens` command."""

import json
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from focusjax._console import BAD_INPUT, FAILED, fail, say, warnings_printed
from focusjax.charts._beams import field_curves, film_at, largest_field
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
    glass: Annotated[
        list[Path] | None,
        typer.Option(
            "--glass", metavar="FILE", help="An AGF catalogue of the lens's glasses; may be repeated."
        ),
    ] = None,
) -> None:
    """Draw a real lens: cross-section, spots, highlights, focus and distortion; list its first-order data."""
    console, errors = Console(), Console(stderr=True)
    try:
        with jax.enable_x64(True), warnings_printed(errors):
            chosen = _chosen(lens, glass or [], focal_length, f_number)
    except ValueError as error:
        fail(errors, error, BAD_INPUT)
    folder = out if out is not None else Path("out") / Path(lens).stem
    try:
        with warnings_printed(errors):
            facts = draw_lens(chosen, folder)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED, folder)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    table = Table(title=Text(chosen.name), show_header=False)
    for name, value in {**facts["first_order"], **facts["wavefront_mm"]}.items():
        table.add_row(name.replace("_", " "), f"{value:.5g}")
    console.print(table)
    say(console, f"Charts: {folder}")


def _chosen(lens: str, glass: list[Path], focal_length: float | None, f_number: float | None) -> Prescription:
    """The lens of a name or file, scaled and stopped down."""
    named = lens in PRESETS or not Path(lens).suffix
    chosen = lens_preset(lens) if named else load_lens(lens, glass=glass)
    if focal_length is not None:
        chosen = with_focal_length(chosen, focal_length)
    return chosen if f_number is None else opened_to(chosen, f_number)


def draw_lens(lens: Prescription, folder: Path) -> dict:
    """Draw the charts of `lens` into `folder` and return what `lens.json` holds.

    First-order data are millimetres from the first vertex (front), from the last (back, rear, exit pupil);
    the wavefront's Seidel coefficients are for the largest field, in mm.

    Everything is computed in float64, whatever the lens has: curves are differences of near rays.

    Raises:
        ValueError: a lens that forms no real images, or a folder that cannot be written.
    """
    with jax.enable_x64(True):
        return _draw(jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=jnp.float64), lens), folder)


def _draw(lens: Prescription, folder: Path) -> dict:
    # Refuses what has no film before anything is drawn.
    with_focal_length(lens, 1.0)
    film, field = film_at(lens), largest_field(lens)
    sums, over_field = seidel_sums(lens, field=field), field_curves(lens, np.linspace(0.0, field, 15), film)
    seen = first_order(lens)
    facts = {
        "name": lens.name,
        "field_deg": float(np.degrees(field)),
        "film_behind_last_vertex": film - float(lens.vertices()[-1]),
        "first_order": {name: float(value) for name, value in vars(seen).items()},
        "wavefront_mm": {name: float(value) for name, value in sums.wavefront().items()},
        "over_field": {
            "angle_deg": np.degrees(over_field.angles).tolist(),
            "tangential_focus_mm": over_field.tangential.tolist(),
            "sagittal_focus_mm": over_field.sagittal.tolist(),
            "distortion_percent": over_field.distortion.tolist(),
        },
        "seidel_mm": {name: np.asarray(value).tolist() for name, value in vars(sums).items()},
    }
    with staged_folder(folder, owned=FILES) as stage:
        cross_section(stage / "section.png", lens, film, field)
        spots(stage / "spots.png", lens, film, field)
        highlights(stage / "highlights.png", lens, field)
        curves(stage / "curves.png", lens, film, over_field)
        (stage / "lens.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    return facts
