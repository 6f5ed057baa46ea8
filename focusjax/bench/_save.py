"""The files that a comparison leaves behind."""

import csv
import dataclasses
import math
from pathlib import Path
from typing import Any

from focusjax._templates import template
from focusjax.bench._pictures import ERROR_PEAK, error_url, file_url, picture_url, save_pareto
from focusjax.bench._run import CaseResults, EqualError, Results, Row
from focusjax.io import json_text

FILES = ("report.html", "results.json", "results.csv", "pareto.png")
"""Every file that a comparison leaves in its folder."""


def save_results(folder: Path, results: Results) -> None:
    """Write the table as CSV, everything as JSON, the plot, and a page that holds it all.

    Args:
        folder: an existing folder; the files are `FILES`.
        results: what `speed_error` returned.
    """
    with (folder / "results.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [field.name for field in dataclasses.fields(Row)])
        writer.writeheader()
        for found in results.cases:
            writer.writerows(dataclasses.asdict(row) for row in found.rows)
    facts = {
        "machine": results.machine,
        "repeats": results.repeats,
        "scenes": [_scene(found) for found in results.cases],
        "failures": results.failures,
    }
    (folder / "results.json").write_text(json_text(facts), encoding="utf-8")
    save_pareto(folder / "pareto.png", results)
    page = template("focusjax.bench", "speed_error.html.j2").render(
        results=results,
        titles={method.name: method.title for method in results.methods},
        knobs={method.name: method.knob for method in results.methods},
        pareto=file_url(folder / "pareto.png"),
        picture=picture_url,
        error=lambda picture, found: error_url(picture, found.reference.picture),
        error_peak=ERROR_PEAK,
        seconds=_seconds,
        reach=_reach,
        ratio=_ratio,
        decibels=_decibels,
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _scene(found: CaseResults) -> dict[str, Any]:
    case, reference = found.case, found.reference
    return {
        "name": case.name,
        "title": case.title,
        "width": case.camera.width,
        "height": case.camera.height,
        "triangles": len(case.scene.faces),
        "focus_distance_m": float(case.lens.focus_distance()),
        "aperture_radius_mm": 1000 * float(case.lens.aperture_radius),
        "silhouette_share": found.silhouette_share,
        "reference": {
            "maker": reference.maker,
            "samples": reference.samples,
            "dropped_samples": reference.dropped,
            "floor_psnr": reference.floor_psnr,
            "seconds": reference.seconds,
            "from_cache": reference.kept,
        },
        "rows": [dataclasses.asdict(row) for row in found.rows],
        "anchor": None if (anchor := found.anchor()) is None else dataclasses.asdict(anchor),
        "equal_error": [dataclasses.asdict(line) for line in found.equal_error()],
        "failures": found.failures,
    }


def _seconds(value: float) -> str:
    return f"{1000 * value:.0f} ms" if value < 0.1 else f"{value:.2f} s"


def _decibels(value: float | None) -> str:
    return "" if value is None else "∞" if math.isinf(value) else f"{value:.2f}"


def _reach(line: EqualError, which: str) -> str:
    """Time to the anchor's error, or that it is never reached."""
    reach = getattr(line, which)
    if math.isinf(reach.seconds):
        return "not reached"
    return ("≤ " if reach.at_most else "") + _seconds(reach.seconds)


def _ratio(line: EqualError, which: str) -> str:
    """How many times sooner than the anchor."""
    value = line.ratio if which == "render" else line.total_ratio
    if value == 0.0:
        return ""
    return ("≥ " if getattr(line, which).at_most else "") + f"{value:.2f}"
