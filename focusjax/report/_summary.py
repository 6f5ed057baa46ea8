"""A run's outcome as plain values: what report.json holds and report.html shows."""

import importlib.metadata
import math
import platform
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.focus import Diagnosis, Result, SurfaceDiagnosis, SurfaceSolution, diagnose
from focusjax.io import for_json
from focusjax.job import Examined, Guessed, Outcome, room_for_more, shutter
from focusjax.lens import FocalSurfaceLens, as_tilt_shift, depth_of_field
from focusjax.report._close_focus import close_focus_facts
from focusjax.report._glass import glass_facts
from focusjax.report._quality import quality_facts

_LIBRARIES = ("focusjax", "jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy", "trimesh", "OpenEXR")
_RESULTS = ("solved", "undetermined", "max_steps_reached", "not_finite")


def summary(outcome: Outcome) -> dict[str, Any]:
    """Everything a run found, in values JSON can hold; keys carry their units.

    Infinite values are the text "inf", since JSON has no word for them.
    """
    return for_json(
        {
            "config_file": str(outcome.config.source),
            "config": outcome.config.model_dump(mode="python", by_alias=True),
            "versions": versions(),
            "lens": _lens(outcome),
            "exposure": _exposure(outcome),
            "wishes": _wishes(outcome),
            "solver": _solver(outcome),
            "diagnosis": _diagnosis(outcome),
            "picture": _picture(outcome),
            "guessed": _guessed(outcome),
            "seconds": outcome.seconds | {"compile": sum(outcome.compile_seconds.values())},
            "compile_seconds": outcome.compile_seconds,
        }
    )


def versions() -> dict[str, str]:
    """Of Python and of the libraries that make the results."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            # A source tree that is used without being installed has no metadata.
            found[name] = "unknown"
    return found


def _lens(outcome: Outcome) -> dict[str, Any]:
    camera, lens = outcome.camera, outcome.middle_lens
    settings = outcome.settings
    sharp = depth_of_field(camera, lens, outcome.config.lens.close_focus)
    return {
        "solved": outcome.solution is not None,
        "focus_distance_m": float(lens.focus_distance()),
        "focus_disparity_per_m": float(lens.focus_disparity),
        "f_number": float(settings.f_number),
        "aperture_radius_mm": 1000 * float(lens.aperture_radius),
        "focal_surface": _focal_surface(outcome),
        "glass": glass_facts(outcome),
        "focal_length_mm": 1000 * float(settings.focal_length),
        "close_focus": close_focus_facts(outcome),
        "sensor_width_mm": 1000 * float(camera.sensor_width),
        "movements": movements(outcome),
        "depth_of_field": {
            "circle_of_confusion_mm": sharp.circle_mm,
            "circle_of_confusion_px": sharp.circle_px,
            "near_m": sharp.near,
            "far_m": sharp.far,
            "hyperfocal_m": sharp.hyperfocal,
        },
    }


def _exposure(outcome: Outcome) -> dict[str, Any] | None:
    """What was set on the camera, and how that went; None where nothing was exposed."""
    if outcome.exposure is None:
        return None
    settings, chosen, sentence = outcome.exposure
    taken, table = outcome.photograph, outcome.config.exposure
    assert table is not None
    return {
        "f_number": float(settings.f_number),
        "effective_f_number": float(settings.effective_f_number()),
        "magnification": float(settings.magnification),
        "time_s": float(settings.time),
        "shutter": shutter(float(settings.time)),
        "iso": float(settings.iso),
        "exposure_value": float(settings.exposure_value()),
        "luminance_of_one_cd_m2": table.luminance,
        "lux_s_of_one": float(settings.exposure(jnp.ones(()))) * table.luminance,
        "chosen": list(table.free),
        "metered_radiance": None if taken is None else taken.metered,
        "stops_off": None if chosen is None else float(chosen.stops_off),
        "limits": [] if chosen is None else list(chosen.limits),
        "sentence": sentence,
        "priority": table.priority,
        "white_share": None if taken is None else taken.white_share,
    }


def movements(outcome: Outcome) -> dict[str, float]:
    """How the lens is turned and slid against the sensor."""
    camera, lens = outcome.camera, outcome.middle_lens
    found = as_tilt_shift(lens).movements(camera)
    distance = found.image_distance
    if outcome.config.lens.close_focus != "ignored":
        # The camera has its sensor there already.
        distance = outcome.settings.image_distance
    return {
        "tilt_deg": math.degrees(float(found.tilt)),
        "swing_deg": math.degrees(float(found.swing)),
        "image_distance_mm": 1000 * float(distance),
        "hinge_distance_m": float(found.hinge_distance),
        "rise_mm": _millimetres(camera.rise),
        "shift_mm": _millimetres(camera.shift),
    }


def _millimetres(metres: Float[Array, ""]) -> float:
    """Without the last bits, which are the rounding of positions in pixels."""
    return round(1000 * float(metres), 6) + 0.0


def _focal_surface(outcome: Outcome) -> dict[str, Any] | None:
    """How far the focus is from place to place; what the other settings say is of the middle."""
    if not isinstance(outcome.lens, FocalSurfaceLens):
        return None
    focus, scale = np.asarray(outcome.lens.focus_disparity), np.asarray(outcome.lens.aperture_scale)
    nearest, farthest = float(focus.max()), float(focus.min())
    facts: dict[str, Any] = {
        "nearest_focus_m": 1.0 / nearest if nearest > 0 else math.inf,
        "farthest_focus_m": 1.0 / farthest if farthest > 0 else math.inf,
        "least_aperture_scale": float(scale.min()),
        "largest_aperture_scale": float(scale.max()),
    }
    if isinstance(outcome.solution, SurfaceSolution):
        facts["roughness_px_per_100_px"] = float(outcome.solution.roughness)
    surface = outcome.surface
    if surface is not None:
        facts["control_points"] = [
            {"pixel": xy, "focus_disparity_per_m": value}
            for xy, value in zip(surface.xy.tolist(), surface.focus_disparity.tolist(), strict=True)
        ]
    return facts


def _wishes(outcome: Outcome) -> list[dict[str, Any]]:
    if outcome.solution is None:
        return []
    return [
        {
            "name": row.name,
            "sharp": row.relation == "equal" and row.wished == 0,
            "relation": row.relation,
            "same_as": row.partner or None,
            "wished_px": row.wished,
            "signed": row.signed,
            "got_px": row.got,
            "residual_px": row.residual,
            "tolerance_px": row.tolerance,
            "met": row.met,
            "counts": row.counts,
            "note": row.note,
            "weight": row.weight,
            "pixel": row.xy,
            "distance_m": row.distance,
            "samples": row.samples,
        }
        for row in outcome.solution.table()
    ]


def _solver(outcome: Outcome) -> dict[str, Any] | None:
    solution = outcome.solution
    if solution is None:
        return None
    if isinstance(solution, SurfaceSolution):
        return {
            "status": "solved",
            "message": "The control values meet the wishes as well as smoothness allows.",
            "steps": 1,
            "cost_px2": float(solution.cost),
            "free": ["focal surface"],
            "undetermined": [],
            "active_bounds": [],
        }
    return {
        "status": status(solution.result),
        "message": str(Result[solution.result]),
        "steps": int(solution.steps),
        "cost_px2": float(solution.cost),
        "free": list(outcome.config.solve.free),
        "undetermined": list(solution.undetermined),
        "active_bounds": list(solution.active_bounds),
    }


def status(result: Result) -> str:
    """How a solve ended, by the name of its result."""
    return next(name for name in _RESULTS if result == getattr(Result, name))


def _diagnosis(outcome: Outcome) -> dict[str, Any] | None:
    solution = outcome.solution
    if solution is None:
        return None
    if isinstance(solution, SurfaceSolution):
        table = outcome.config.lens.focal_surface
        assert table is not None
        names = [point.name or point.object or f"{k}" for k, point in enumerate(table.points)]
        surface = diagnose(solution, controls=names)
        return _stood_in_the_way(surface) | {
            "open_control_points": list(surface.open_controls),
            "smoothness_costs_px": surface.smoothness_costs,
            "beyond_infinity": list(surface.beyond_infinity),
        }
    found = diagnose(solution)
    return _stood_in_the_way(found) | {
        "directions": list(found.directions),
        "open_directions": list(found.open_directions),
        "standard_errors": found.standard_errors,
        "active_bounds": list(found.active_bounds),
    }


def _stood_in_the_way(found: Diagnosis | SurfaceDiagnosis) -> dict[str, Any]:
    """What lenses and focal surfaces have in common."""
    return {
        "sentences": list(found.sentences),
        "singular_values_px": list(found.singular_values),
        "conflicts": [
            {
                "wishes": [each.first, each.second],
                "gains_px": [each.first_gains, each.second_gains],
            }
            for each in found.conflicts
        ],
        "unreachable": [{"wish": each.name, "best_px": each.best} for each in found.unreachable],
    }


def left_out(outcome: Outcome) -> str | None:
    """How much found no place in the layers, in a sentence; None where everything did."""
    picture = outcome.picture
    if picture is None or picture.complete:
        return None
    left, kept, layers = picture.samples_left_out, picture.samples_kept, picture.layer_count
    share = 100.0 * left / max(left + kept, 1)
    return (
        f"{left:,} samples of surface ({share:.2g} % of those that the lens may see) found no place in"
        f" {layers} layer{'s' * (layers != 1)}, so that light from them is missing;"
        f" {room_for_more(outcome.config.render)}."
    )


def _picture(outcome: Outcome) -> dict[str, Any] | None:
    picture = outcome.picture
    if picture is None:
        return None
    return {
        "method": picture.method,
        "layers": picture.layer_count,
        "layers_complete": picture.complete,
        "layers_left_out": left_out(outcome),
        "layer_samples_left_out": picture.samples_left_out,
        "layer_samples": picture.samples_kept,
        "layers_mib": picture.layer_bytes / 2**20,
        "examined": _examined(picture.examined),
        "margin_px": picture.margin,
        "rays_per_pixel": picture.rays,
        "quality": quality_facts(outcome),
        "largest_blur_px": float(np.abs(outcome.blur).max()),
        "largest_motion_px": picture.motion_px,
        "shutter_spans": picture.spans,
    }


def _guessed(outcome: Outcome) -> dict[str, Any] | None:
    """How much of the light of a photograph with depth is a guess."""
    if outcome.guessed is None:
        return None
    return {
        "light_share": outcome.guessed.light,
        "depth_share": outcome.guessed.depth,
        "sentence": guessed_sentence(outcome.guessed),
    }


def guessed_sentence(found: Guessed) -> str:
    """The shares in words."""
    behind = (
        f"{100 * found.light:.1f} % of the light in this picture was guessed: it comes from behind"
        " foregrounds or from beyond the frame of the photograph."
    )
    if found.depth < 5e-4:
        return behind
    return f"{behind} The depth of another {100 * found.depth:.1f} % was not measured."


def _examined(found: Examined | None) -> dict[str, Any] | None:
    """What the layers miss, and what the umbra spares them."""
    if found is None:
        return None
    return {
        "missed_share": found.missed.share,
        "counts_what_is_seen_through": not found.see_through,
        "missed_standard_error": found.missed.standard_error,
        "layers_with_umbra": len(found.saving.umbra),
        "layers_without": len(found.saving.plain),
        "samples_saved_share": found.saving.samples_saved,
    }
