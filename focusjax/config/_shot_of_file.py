"""The frames of a USD stage, where a config has a `[shot]` and does not say otherwise itself."""

from pathlib import Path
from typing import Any

import numpy as np

from focusjax.config._camera_of_file import POSE, camera_file, camera_file_key
from focusjax.config._errors import ConfigError
from focusjax.config._reach import Reach
from focusjax.scene_files import StoredCamera, read_camera_frames


def with_shot_of_file(filled: dict[str, Any], given: dict[str, Any], reach: Reach) -> dict[str, Any]:
    """`filled` with a `[shot]` that has the number of frames, the rate, and keyframes of the file's camera.

    Args:
        filled: all tables, the first frame's camera and lens in them.
        given: the tables as the config has them.
        reach: where files may lie.

    Raises:
        ConfigError: the file cannot be read.
    """
    shot, name = given.get("shot"), camera_file(given)
    if not isinstance(shot, dict) or name is None or not Path(name).suffix.lower().startswith(".usd"):
        return filled
    camera, lens = given.get("camera", {}), given.get("lens", {})
    try:
        path = reach.file(name, camera_file_key(given))
        found = read_camera_frames(path, camera.get("from"), within=reach.folders(name))
    except ValueError as error:
        raise ConfigError(f"{reach.source}: {error}") from error
    if len(found.cameras) == 1:
        return filled
    more: dict[str, Any] = {"frames": len(found.cameras), "fps": found.fps}
    if not any(key in camera for key in POSE):
        own_length = any(key in camera for key in ("focal_length_mm", "field_of_view_deg", "sensor_width_mm"))
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
