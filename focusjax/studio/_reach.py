"""The lens to peel for, so that the layers serve every lens that the wishes may come to."""

from typing import TypeAlias

import numpy as np

from focusjax.config import Config
from focusjax.geometry import Camera
from focusjax.inverse import widest_lens
from focusjax.lens import AbstractLens, FocalSurfaceLens, ThinLens, TiltShiftLens
from focusjax.studio._stage import Stage

Solved: TypeAlias = ThinLens | TiltShiftLens | FocalSurfaceLens
_ROOM = 1.4
"""Factor on the aperture, and on nearness, beyond what is solved for, where the config sets no limit."""
_IN_FRONT = 0.7
"""Share of the nearest visible distance in front of which hardly anything is focused on."""


def lens_to_peel_for(config: Config, stage: Stage, lens: Solved) -> AbstractLens | None:
    """A lens whose rays go as far as those of any within the config's limits, and as those of `lens`.

    Where the config has no limits, there is some room around `lens`. None where there is no such lens, so
    that layers are peeled for one lens only.
    """
    table, given, camera = config.solve, config.solve.model_fields_set, stage.camera
    widest = float(lens.aperture_radius)
    if isinstance(lens, FocalSurfaceLens):
        widest *= float(lens.aperture_scale.max())
    number = float(camera.focal_length) / (2.0 * widest) if widest else np.inf
    if not np.isfinite(number):
        return None
    if "f_number" in table.free and "f_number_min" in given:
        number = min(number, table.f_number_min)
    else:
        number /= _ROOM
    nearest = float(stage.disparity.max(initial=0.0)) / _IN_FRONT
    focus = _nearest_focus(camera, lens)
    allowed = _ROOM * focus
    if "focus" in table.free:
        allowed = 1.0 / (table.min_focus_distance_m or 2.0 * float(camera.focal_length))
    nearest = max(min(nearest, allowed), focus)
    if not nearest > 0:
        return None
    try:
        return widest_lens(
            camera,
            min_focus_distance=1.0 / nearest,
            f_number=number,
            max_tilt=_most_turned(config, camera, lens),
        )
    except ValueError:
        return None


def _nearest_focus(camera: Camera, lens: Solved) -> float:
    """Disparity in 1/m of the nearest place that is in focus within the frame."""
    if isinstance(lens, FocalSurfaceLens):
        return float(lens.focus_disparity.max())
    if isinstance(lens, ThinLens):
        return float(lens.focus_disparity)
    corners = np.array([(x, y) for x in (0.0, camera.width) for y in (0.0, camera.height)])
    offset = (corners - np.asarray(camera.principal_point)) / float(camera.focal_px)
    plane = np.asarray(lens.plane)
    return float((plane[2] + offset[:, 0] * plane[0] - offset[:, 1] * plane[1]).max())


def _most_turned(config: Config, camera: Camera, lens: Solved) -> float:
    """Radians that the lens may be turned: to the limits that are given, or a little beyond `lens`."""
    turned = 0.0
    if isinstance(lens, TiltShiftLens):
        plane = np.asarray(lens.plane)
        sine = float(camera.focal_length) * float(np.hypot(*plane[:2]))
        turned = _ROOM * float(np.arcsin(min(1.0, sine)))
    table, given = config.solve, config.solve.model_fields_set
    for name in {"tilt", "swing"} & set(table.free):
        for key in {f"{name}_min_deg", f"{name}_max_deg"} & given:
            turned = max(turned, float(np.radians(abs(getattr(table, key)))))
    return turned
