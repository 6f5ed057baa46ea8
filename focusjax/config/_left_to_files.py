"""What a config leaves to files that it names: cameras, lenses and frames, and the camera of a photograph."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from focusjax.config._errors import ConfigError, located
from focusjax.config._reach import Reach
from focusjax.config._scene import PhotoTable
from focusjax.photo import photo_camera
from focusjax.scene_files import StoredCamera, read_camera, read_camera_frames

_POSE = ("matrix", "position", "look_at", "up")
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
    name = _camera_file(data)
    if name is None or not isinstance(lens, dict):
        if isinstance(camera, dict) and isinstance(camera.get("from"), str) and "file" not in camera:
            raise ConfigError(
                f"{reach.source}: camera.from is {camera['from']!r}, and there is no file to take a camera"
                " from; give scene.file or camera.file"
            )
        return data
    with located(reach.source):
        path = reach.file(name, _camera_file_key(data))
        found = read_camera(path, camera.get("from"), within=reach.folders(name))
    return {**data, "camera": {**_camera(found, camera), **camera}, "lens": {**_lens(found, lens), **lens}}


def _camera_file(data: dict[str, Any]) -> str | None:
    """The file that the camera is to be read from; None for none, and where tables have other types."""
    camera, scene = data.get("camera", {}), data.get("scene", {})
    if not isinstance(camera, dict) or not isinstance(camera.get("from"), str | None):
        return None
    name = camera.get("file")
    if name is None and isinstance(scene, dict) and ("from" in camera or not any(k in camera for k in _POSE)):
        name = scene.get("file")
    return name if isinstance(name, str) else None


def _camera_file_key(data: dict[str, Any]) -> str:
    """The key that `_camera_file` has its file from."""
    return "scene.file" if data.get("camera", {}).get("file") is None else "camera.file"


def _camera(found: StoredCamera, given: dict[str, Any]) -> dict[str, Any]:
    filled: dict[str, Any] = {}
    if not any(key in given for key in _POSE):
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


def with_shot_of_file(filled: dict[str, Any], given: dict[str, Any], reach: Reach) -> dict[str, Any]:
    """`filled` with a `[shot]` that has the number of frames, the rate, and keyframes of the file's camera.

    Args:
        filled: all tables, the first frame's camera and lens in them.
        given: the tables as the config has them.
        reach: where files may lie.

    Raises:
        ConfigError: the file cannot be read.
    """
    shot, name = given.get("shot"), _camera_file(given)
    if not isinstance(shot, dict) or name is None or not Path(name).suffix.lower().startswith(".usd"):
        return filled
    camera, lens = given.get("camera", {}), given.get("lens", {})
    with located(reach.source):
        path = reach.file(name, _camera_file_key(given))
        found = read_camera_frames(path, camera.get("from"), within=reach.folders(name))
    if len(found.cameras) == 1:
        return filled
    more: dict[str, Any] = {"frames": len(found.cameras), "fps": found.fps}
    if not any(key in camera for key in _POSE):
        own_length = any(key in camera for key in (*_LENGTH, "sensor_width_mm"))
        keys = _camera_keys(found.cameras, own_length=own_length)
        more |= {"camera": keys, "between": "linear"} if keys else {}
    stops = [each.f_number for each in found.cameras]
    if "f_number" not in lens and len(set(stops)) > 1 and all(stops):
        more["lens"] = [{"frame": k + 1, "f_number": stop} for k, stop in enumerate(stops)]
    return {**filled, "shot": {**more, **shot}}


def _camera_keys(cameras: tuple[StoredCamera, ...], *, own_length: bool) -> list[dict[str, Any]]:
    """A keyframe for every frame of a camera that moves or zooms; none for one that does neither."""
    moves = any(not np.array_equal(each.pose, cameras[0].pose) for each in cameras)
    zooms = not own_length and any(each.focal_length != cameras[0].focal_length for each in cameras)
    keys = []
    for number, each in enumerate(cameras, start=1):
        key: dict[str, Any] = {"frame": number}
        if moves:
            key["matrix"] = each.pose.tolist()
        if zooms:
            assert each.focal_length is not None
            key["focal_length_mm"] = 1000 * each.focal_length
        keys.append(key)
    return keys if moves or zooms else []
