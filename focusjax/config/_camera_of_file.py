"""The camera and lens of `[camera] file`, where a config does not say otherwise itself."""

import math
from typing import Any

import numpy as np

from focusjax.config._errors import ConfigError
from focusjax.config._reach import Reach
from focusjax.scene_files import StoredCamera, read_camera

POSE = ("matrix", "position", "look_at", "up")
_LENGTH = ("focal_length_mm", "field_of_view_deg")
_STOP = ("f_number", "aperture_radius_mm", "sharp_from_m", "sharp_to_m")
_FOCUS = ("focus_distance_m", "focal_surface", "sharp_from_m", "sharp_to_m")
_USUAL_WIDTH = 0.036


def with_camera_of_file(data: dict[str, Any], reach: Reach) -> dict[str, Any]:
    """`data` with what the file says of camera and lens, where its tables say nothing themselves.

    The file is that of `[camera]`, or else that of `[scene]` where `[camera]` has no pose of its own.

    Raises:
        ConfigError: the file cannot be read, or has no such camera; a name and no file.
    """
    camera, lens = data.get("camera", {}), data.get("lens", {})
    name = camera_file(data)
    if name is None or not isinstance(lens, dict):
        if isinstance(camera, dict) and isinstance(camera.get("from"), str) and "file" not in camera:
            raise ConfigError(
                f"{reach.source}: camera.from is {camera['from']!r}, and there is no file to take a camera"
                " from; give scene.file or camera.file"
            )
        return data
    try:
        path = reach.file(name, camera_file_key(data))
        found = read_camera(path, camera.get("from"), within=reach.folders(name))
    except ValueError as error:
        raise ConfigError(f"{reach.source}: {error}") from error
    return {**data, "camera": {**_camera(found, camera), **camera}, "lens": {**_lens(found, lens), **lens}}


def camera_file(data: dict[str, Any]) -> str | None:
    """The file that the camera is to be read from; None for none, and where tables have other types."""
    camera, scene = data.get("camera", {}), data.get("scene", {})
    if not isinstance(camera, dict) or not isinstance(camera.get("from"), str | None):
        return None
    name = camera.get("file")
    if name is None and isinstance(scene, dict) and ("from" in camera or not any(k in camera for k in POSE)):
        name = scene.get("file")
    return name if isinstance(name, str) else None


def camera_file_key(data: dict[str, Any]) -> str:
    """The key that `camera_file` has its file from."""
    return "scene.file" if data.get("camera", {}).get("file") is None else "camera.file"


def _camera(found: StoredCamera, given: dict[str, Any]) -> dict[str, Any]:
    filled: dict[str, Any] = {}
    if not any(key in given for key in POSE):
        filled["matrix"] = found.pose.tolist()
    if found.resolution is not None:
        filled["resolution"] = list(found.resolution)
    if any(key in given for key in _LENGTH):
        return filled
    if found.field_of_view is not None:
        size = np.asarray(given.get("resolution", ()))
        if size.shape == (2,) and size.dtype.kind in "iuf" and (size > 0).all():
            width = given.get("sensor_width_mm", 1000 * _USUAL_WIDTH)
            half_height = width * float(size[1] / size[0]) / 2 if isinstance(width, int | float) else math.nan
            filled["focal_length_mm"] = half_height / math.tan(found.field_of_view / 2)
    elif "sensor_width_mm" not in given:
        assert found.focal_length is not None
        assert found.sensor_width is not None
        filled["focal_length_mm"] = 1000 * found.focal_length
        filled["sensor_width_mm"] = 1000 * found.sensor_width
        filled |= {"shift_mm": 1000 * found.shift, "rise_mm": 1000 * found.rise}
    return filled


def _lens(found: StoredCamera, given: dict[str, Any]) -> dict[str, Any]:
    filled: dict[str, Any] = {}
    if found.f_number is not None and not any(key in given for key in _STOP):
        filled |= {"f_number": found.f_number} if found.f_number else {"aperture_radius_mm": 0.0}
    if found.focus_distance is not None and not any(key in given for key in _FOCUS):
        filled["focus_distance_m"] = found.focus_distance
    if found.tilt or found.swing:
        filled |= {"tilt_deg": math.degrees(found.tilt), "swing_deg": math.degrees(found.swing)}
    shape = found.opening
    if shape is not None and shape.blades:
        filled["aperture"] = {
            "shape": "polygon",
            "blades": shape.blades,
            "rotation_deg": math.degrees(shape.rotation),
            "roundness": shape.roundness,
            "squeeze": shape.squeeze,
        }
    elif shape is not None and shape.squeeze != 1.0:
        filled["aperture"] = {"shape": "disk", "squeeze": shape.squeeze}
    return filled
