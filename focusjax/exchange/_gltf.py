"""Cameras for glTF 2.0, as JSON (`.gltf`): a perspective camera on a node.

glTF knows neither focus nor opening: these are in the camera's `extras`, under "focusjax", in metres, radians
and 1/m, which `[camera] file` reads again. A shot is an animation of the node, and of the field of view by
the extension KHR_animation_pointer where the camera zooms. Source: the specification of glTF 2.0 (Khronos).
"""

import base64
import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.exchange._record import Frame, Record
from focusjax.io import json_text, replace_file

_FLOAT = 5126


def write_gltf(record: Record, path: Path) -> tuple[Path, ...]:
    """Write a scene that holds the camera alone."""
    replace_file(path, json_text(gltf_document(record)))
    return (path,)


def gltf_document(record: Record) -> dict[str, Any]:
    """The document as `json` takes it."""
    first = record.frames[0]
    extras: dict[str, Any] = {"focusjax": _extras(record, first)}
    if record.is_shot:
        extras["focusjax"]["fps"] = record.fps
        extras["focusjax"]["frames"] = [_lens(frame) for frame in record.frames]
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "focusjax"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {
                "name": record.name,
                "camera": 0,
                "translation": first.pose[:3, 3].tolist(),
                "rotation": _quaternions(record)[0].tolist(),
            }
        ],
        "cameras": [
            {
                "name": record.name,
                "type": "perspective",
                "perspective": {
                    "yfov": _yfov(record, first),
                    "aspectRatio": record.width / record.height,
                    "znear": 0.01,
                },
                "extras": extras,
            }
        ],
    }
    return document | (_animation(record) if record.is_shot else {})


def _yfov(record: Record, frame: Frame) -> float:
    height = frame.sensor_width * record.height / record.width
    return 2.0 * math.atan(height / 2.0 / frame.focal_length)


def _lens(frame: Frame) -> dict[str, Any]:
    return {
        "focal_length_m": frame.focal_length,
        "sensor_width_m": frame.sensor_width,
        "focus_distance_m": frame.focus_distance,
        "f_number": frame.f_number,
        "aperture_radius_m": frame.aperture_radius,
        "tilt_rad": frame.tilt,
        "swing_rad": frame.swing,
    }


def _extras(record: Record, frame: Frame) -> dict[str, Any]:
    opening = record.opening
    shape = {"blades": opening.blades, "blade_rotation_rad": opening.rotation, "roundness": opening.roundness}
    size = {"width_px": record.width, "height_px": record.height}
    return _lens(frame) | size | (shape if opening.blades else {}) | {"squeeze": opening.squeeze}


def _quaternions(record: Record) -> Float[np.ndarray, "t 4"]:
    """Rotations as (x, y, z, w), each in the same half as the one before."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(np.stack([frame.pose[:3, :3] for frame in record.frames])).as_quat()
    for index in range(1, len(turns)):
        if turns[index] @ turns[index - 1] < 0:
            turns[index] = -turns[index]
    return turns


def _animation(record: Record) -> dict[str, Any]:
    """Buffers, accessors and channels for the frames after each other; frame 1 is at 0 s."""
    times = np.arange(len(record.frames))[:, None] / record.fps
    tracks: list[tuple[str, Float[np.ndarray, "t _"]]] = [
        ("translation", np.stack([frame.pose[:3, 3] for frame in record.frames])),
        ("rotation", _quaternions(record)),
    ]
    zooms = len({frame.focal_length / frame.sensor_width for frame in record.frames}) > 1
    if zooms:
        tracks.append(("pointer", np.array([[_yfov(record, frame)] for frame in record.frames])))
    data, views, accessors = b"", [], []
    for values in (times, *(track[1] for track in tracks)):
        single = values.astype("<f4")
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": single.nbytes})
        accessors.append(
            {
                "bufferView": len(accessors),
                "componentType": _FLOAT,
                "count": len(single),
                "type": {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[single.shape[1]],
                "min": single.min(axis=0).tolist(),
                "max": single.max(axis=0).tolist(),
            }
        )
        data += single.tobytes()
    encoded = base64.b64encode(data).decode("ascii")
    uri = f"data:application/octet-stream;base64,{encoded}"
    pointer = {"KHR_animation_pointer": {"pointer": "/cameras/0/perspective/yfov"}}
    channels = [
        {
            "sampler": index,
            "target": {"path": path, "extensions": pointer}
            if path == "pointer"
            else {"node": 0, "path": path},
        }
        for index, (path, _) in enumerate(tracks)
    ]
    samplers = [{"input": 0, "output": index + 1, "interpolation": "LINEAR"} for index in range(len(tracks))]
    animation = {"name": f"{record.name} shot", "channels": channels, "samplers": samplers}
    extension = {"extensionsUsed": ["KHR_animation_pointer"]} if zooms else {}
    return {
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "bufferViews": views,
        "accessors": accessors,
        "animations": [animation],
        **extension,
    }
