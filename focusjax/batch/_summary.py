"""The summary of a batch: a table, the same with more in it as JSON, and a page with thumbnails."""

import csv
import io
import math
from typing import Any
from urllib.parse import quote

from focusjax._templates import template
from focusjax.batch._grid import shown
from focusjax.batch._results import BatchResults, ItemResult
from focusjax.batch._work import THUMBNAIL
from focusjax.io import json_text, replace_file
from focusjax.report import angle, f_number, metres, versions

SCHEMA = "focusjax.batch.summary/1"
"""What summary.json says it is; the number changes when a program that reads it has to."""


def save_summary(batch: BatchResults) -> None:
    """Write summary.csv, summary.json and summary.html; each is replaced in one step."""
    replace_file(batch.folder / "summary.csv", _csv(batch))
    replace_file(batch.folder / "summary.json", json_text(_facts(batch)))
    replace_file(batch.folder / "summary.html", _page(batch))


def _csv(batch: BatchResults) -> str:
    """A line per item: its name and status, the keys it changes, and what came of it."""
    stream = io.StringIO()
    lines = [_line(result, batch.keys) for result in batch.results]
    writer = csv.DictWriter(stream, lines[0])
    writer.writeheader()
    writer.writerows(lines)
    return stream.getvalue()


def _line(result: ItemResult, keys: list[str]) -> dict[str, Any]:
    changes = dict(result.item.changes)
    facts, worst = result.facts, result.worst_wish
    lens = facts.get("lens") or {}
    moved, solver = lens.get("movements") or {}, facts.get("solver") or {}
    counted = result.counted
    return {
        "name": result.item.name,
        "status": result.status,
        "config": result.item.config.source,
        # Dotted keys are what was asked for, plain ones what was found.
        **{key: shown(changes[key]) if key in changes else "" for key in keys},
        "verdict": ("met" if result.wishes_met == len(counted) else "missed") if counted else "",
        "wishes": len(counted) if facts else "",
        "wishes_met": result.wishes_met if facts else "",
        "worst_wish": "" if worst is None else worst["name"],
        "worst_error_px": "" if worst is None else result.worst_error,
        "focus_distance_m": lens.get("focus_distance_m"),
        "f_number": lens.get("f_number"),
        "focal_length_mm": lens.get("focal_length_mm"),
        # Plus zero: an angle of -0.0 is 0.0.
        **{key: moved[key] + 0.0 if moved else None for key in ("tilt_deg", "swing_deg")},
        "solver": solver.get("status"),
        "cost_px2": solver.get("cost_px2"),
        "active_bounds": " ".join(solver.get("active_bounds", ())),
        "undetermined": " ".join(solver.get("undetermined", ())),
        "seconds": facts.get("seconds"),
        "message": result.message,
    }


def _facts(batch: BatchResults) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "focusjax": versions()["focusjax"],
        "finished": not batch.having("waiting"),
        "solve_only": batch.solve_only,
        "counts": {
            "items": len(batch.results),
            **{status: len(batch.having(status)) for status in ("done", "failed", "waiting")},
        },
        "items": [_item(result) for result in batch.results],
    }


def _item(result: ItemResult) -> dict[str, Any]:
    done = result.status == "done"
    return {
        "name": result.item.name,
        "status": result.status,
        "message": result.message,
        "config_file": str(result.item.config.source),
        "changes": dict(result.item.changes),
        "folder": result.item.name if done else None,
        "wishes_counted": len(result.counted),
        "wishes_met": result.wishes_met,
        "worst_wish": None if result.worst_wish is None else result.worst_wish["name"],
        "worst_error_px": None if result.worst_wish is None else result.worst_error,
        **{key: result.facts.get(key) for key in ("lens", "solver", "wishes", "seconds", "warnings")},
    }


def _page(batch: BatchResults) -> str:
    counted = [result for result in batch.having("done") if result.counted]
    return template("focusjax.batch", "summary.html.j2").render(
        batch=batch,
        keys=batch.keys,
        configs=len({result.item.config.source for result in batch.results}),
        all_met=sum(result.wishes_met == len(result.counted) for result in counted),
        counted=len(counted),
        seconds=sum(result.facts["seconds"] for result in batch.having("done")),
        turned=any(
            result.facts["lens"]["movements"][key]
            for result in batch.having("done")
            for key in ("tilt_deg", "swing_deg")
        ),
        zoomed=len({result.facts["lens"]["focal_length_mm"] for result in batch.having("done")}) > 1,
        thumbnail=lambda result: f"{quote(result.item.name)}/{THUMBNAIL}",
        report=lambda result: f"{quote(result.item.name)}/report.html",
        changed=lambda result, key: shown(dict(result.item.changes).get(key, "")),
        metres=metres,
        f_number=f_number,
        angle=angle,
        pixels=lambda value: "∞" if math.isinf(float(value)) else f"{float(value):.2f}",
        duration=_duration,
        version=versions()["focusjax"],
    )


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes / 60:.1f} h"
