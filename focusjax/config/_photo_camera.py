"""What a config with a `[scene.photo]` leaves to the photograph: its camera, and how finely it is sampled."""

from typing import Any

import numpy as np
from pydantic import ValidationError

from focusjax.config._errors import ConfigError
from focusjax.config._photo import PhotoTable
from focusjax.config._reach import Reach
from focusjax.photo import photo_camera

_POSE = ("matrix", "position", "look_at", "up")
_LENGTH = ("focal_length_mm", "field_of_view_deg")


def with_camera_of_photo(data: dict[str, Any], reach: Reach) -> dict[str, Any]:
    """`data` with a `[camera]` that has what the photograph says, where it says nothing itself.

    A picture that is smaller than the photograph has two samples along each side of a pixel unless
    `render.supersampling` says otherwise: one would leave out every other pixel of the photograph.

    Raises:
        ConfigError: the photograph cannot be read, does not say its focal length, or half of another pose is
            given.
    """
    scene, camera = data.get("scene"), data.get("camera", {})
    if not isinstance(scene, dict) or "photo" not in scene or not isinstance(camera, dict):
        return data
    try:
        table = PhotoTable.model_validate(scene["photo"])
    except ValidationError:
        # Refused where all tables are looked at.
        return data
    posed = [key for key in _POSE if key in camera]
    if posed and "matrix" not in camera and not {"position", "look_at"} <= set(posed):
        raise ConfigError(
            f"{table.file} brings the camera that took it, and camera.{posed[0]} is only half of another pose"
            "; leave it out, or give both position and look_at"
        )
    try:
        taken = photo_camera(
            reach.file(table.file, "scene.photo.file"),
            focal_length_35mm=table.focal_length_35mm,
            focal_length_px=table.focal_length_px,
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error
    filled: dict[str, Any] = {"resolution": [taken.width, taken.height]}
    if not posed:
        filled["matrix"] = np.asarray(taken.world_from_camera, dtype=float).tolist()
    if not any(key in camera for key in (*_LENGTH, "sensor_width_mm")):
        filled["focal_length_mm"] = 1000 * float(taken.focal_length)
        filled["sensor_width_mm"] = 1000 * float(taken.sensor_width)
    whole = {**data, "camera": {**filled, **camera}}
    render = data.get("render", {})
    if _smaller(camera.get("resolution"), (taken.width, taken.height)) and isinstance(render, dict):
        whole["render"] = {"supersampling": 2, **render}
    return whole


def _smaller(resolution: Any, size: tuple[int, int]) -> bool:
    """Whether a resolution, which may be no resolution, has fewer pixels along a side than `size`."""
    if not isinstance(resolution, list | tuple) or len(resolution) != 2:
        return False
    return any(
        isinstance(pixels, int | float) and pixels < most
        for pixels, most in zip(resolution, size, strict=True)
    )
