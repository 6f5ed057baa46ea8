"""What a shot leaves behind beside its frames: report.json, report.html and the curves."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from focusjax._templates import template
from focusjax.config import Config
from focusjax.focus import FramesSolution, Result, SurfaceFramesSolution
from focusjax.io import for_json, json_text
from focusjax.job import room_for_more
from focusjax.report import data_url, status, title_of, versions
from focusjax.shot._render import RenderedFrames
from focusjax.shot._solve import SolvedShot

REPORT_FILES = (
    "report.json",
    "report.html",
    "settings.png",
    "blur.png",
    "contact.png",
    "shot.mp4",
    "long_exposure.png",
    "long_exposure.exr",
)
"""Every file that a shot can leave in its folder, beside the folder `frames`."""

SETTING_NAMES = {
    "focus_per_m": ("Focus", "dioptres"),
    "f_number": ("f-number", ""),
    "focal_length_mm": ("Focal length", "mm"),
    "tilt_deg": ("Tilt", "°"),
    "swing_deg": ("Swing", "°"),
    "image_distance_mm": ("Image distance", "mm"),
}
"""What people call the settings of a shot, and their units."""


def save_report(
    folder: Path,
    config: Config,
    solved: SolvedShot,
    rendered: RenderedFrames | None,
    seconds: Mapping[str, float],
    compile_seconds: Mapping[str, float],
) -> dict[str, Any]:
    """Write the report's files into an existing folder, and return what report.json holds."""
    # matplotlib takes long to import.
    from focusjax.shot._curves import save_blur_curves, save_contact_sheet, save_settings_curves

    save_settings_curves(folder / "settings.png", solved)
    pictures = ["settings"]
    if solved.shot.wishes:
        save_blur_curves(folder / "blur.png", solved)
        pictures.append("blur")
    if rendered is not None:
        pngs = [path for files in rendered.files for path in files if path.suffix == ".png"]
        if pngs:
            save_contact_sheet(folder / "contact.png", pngs)
            pictures.append("contact")
    if (folder / "long_exposure.png").is_file():
        pictures.append("long_exposure")
    facts = shot_summary(config, solved, rendered, seconds, compile_seconds)
    (folder / "report.json").write_text(json_text(facts))
    text = template("focusjax.shot", "shot.html.j2").render(
        title=title_of(config),
        facts=facts,
        pictures={name: data_url(folder / f"{name}.png") for name in pictures},
        names=SETTING_NAMES,
        changing=[name for name, change in solved.solution.largest_changes().items() if change.seen],
    )
    (folder / "report.html").write_text(text, encoding="utf-8")
    return facts


def shot_summary(
    config: Config,
    solved: SolvedShot,
    rendered: RenderedFrames | None,
    seconds: Mapping[str, float],
    compile_seconds: Mapping[str, float],
) -> dict[str, Any]:
    """A shot in values JSON can hold; keys carry their units, and infinite values are the text "inf"."""
    solution = solved.solution
    settings = solution.settings()
    return for_json(
        {
            "config_file": str(config.source),
            "config": config.model_dump(mode="python", by_alias=True),
            "versions": versions(),
            "solver": {
                "status": status(solution.result) if solved.shot.wishes else "keyed",
                "message": str(Result[solution.result]) if solved.shot.wishes else "",
                "steps": int(solution.steps) if isinstance(solution, FramesSolution) else 1,
                "cost_px2": float(solution.cost),
                "roughness_px2": float(solution.roughness),
            }
            | _freedom(solution),
            "largest_changes": {
                name: dataclasses.asdict(change) for name, change in solution.largest_changes().items()
            },
            "wishes": _wishes(solved),
            "diagnosis": _diagnosis(solved),
            "frames": [
                {"frame": t + 1}
                | {name: float(values[t]) for name, values in settings.items()}
                | {"wishes": _rows(solved, t)}
                for t in range(solution.count)
            ],
            "pictures": None
            if rendered is None
            else {
                "frames": list(rendered.frames),
                "kept": rendered.kept,
                "rays_per_pixel": rendered.rays,
                "layers_complete": rendered.complete,
                "layers_left_out": left_out_of_frames(config, rendered),
            }
            | _motion(rendered)
            | _long_exposure(config, rendered),
            "seconds": dict(seconds) | {"compile": sum(compile_seconds.values())},
            "compile_seconds": dict(compile_seconds),
        }
    )


def _freedom(solution: FramesSolution | SurfaceFramesSolution) -> dict[str, Any]:
    """What was solved for, and what stood against it."""
    if isinstance(solution, SurfaceFramesSolution):
        free = ["focal_surface"] if solution.points.names else []
        return {"free": free, "undetermined": [], "frames_at_bounds": 0}
    return {
        "free": list(solution.free),
        "undetermined": list(solution.undetermined),
        "frames_at_bounds": int(np.sum(np.asarray(solution.at_lower) | np.asarray(solution.at_upper))),
    }


def _diagnosis(solved: SolvedShot) -> dict[str, Any]:
    """What keeps the lenses from meeting the wishes; frames are first and last of each stretch, from 1."""
    found = solved.diagnosis
    return {
        "sentences": list(found.sentences),
        "missed": [
            {
                "wish": each.name,
                "frames": each.frames,
                "worst_px": each.worst,
                "worst_frame": each.worst_frame,
                "smoothness_costs_px": each.smoothness_costs,
            }
            for each in found.missed
        ],
        "conflicts": [
            {
                "wishes": [each.first, each.second],
                "gains_px": [each.first_gains, each.second_gains],
                "frames": each.frames,
            }
            for each in found.conflicts
        ],
        "unreachable": [
            {"wish": each.name, "best_px": each.best, "frames": each.frames} for each in found.unreachable
        ],
        "active_bounds": found.active_bounds,
        "idle": list(found.idle),
    }


def _wishes(solved: SolvedShot) -> list[dict[str, Any]]:
    """One entry per wish over the whole shot."""
    missed = {name: (count, error) for name, count, error in solved.missed()}
    found = []
    for number, name in enumerate(solved.solution.points.names):
        share = solved.share[:, number]
        count, error = missed.get(name, (0, 0.0))
        found.append(
            {
                "name": name,
                "frames_in_full": int(np.sum(share > 1.0 - 1e-6)),
                "frames_in_part": int(np.sum((share > 0) & (share <= 1.0 - 1e-6))),
                "frames_missed": count,
                "worst_miss_px": error,
            }
        )
    return found


def _rows(solved: SolvedShot, frame: int) -> list[dict[str, Any]]:
    return [
        {
            "name": row.name,
            "wished_px": row.wished,
            "got_px": row.got,
            "residual_px": row.residual,
            "met": row.met,
            "weight": row.weight,
            "share": float(solved.share[frame, number]),
            "pixel": row.xy,
            "distance_m": row.distance,
        }
        for number, row in enumerate(solved.solution.table(frame))
    ]


def left_out_of_frames(config: Config, rendered: RenderedFrames) -> str | None:
    """How much found no place in the layers, in a sentence; None where everything did."""
    if rendered.complete:
        return None
    return (
        f"{rendered.left_out:,} samples of surface that the lens may see found no place in the layers of"
        f" frame {rendered.worst_frame}, so that light from them is missing; {room_for_more(config.render)}."
    )


def _motion(rendered: RenderedFrames) -> dict[str, Any]:
    """What moved while the shutter was open; nothing without one."""
    if rendered.motion_px is None:
        return {}
    return {"largest_motion_px": rendered.motion_px, "shutter_spans": rendered.spans}


def _long_exposure(config: Config, rendered: RenderedFrames) -> dict[str, Any]:
    """How many frames went into it; nothing without one."""
    made = config.shot is not None and config.shot.long_exposure
    return {"long_exposure_frames": len(rendered.frames)} if made else {}
