"""Cameras of glTF 2.0: a node's place in the hierarchy, and a vertical field of view.

glTF's units and axes are focusjax's. The lens is in `extras`, under "focusjax", where focusjax wrote the
file. Source: the specification of glTF 2.0 (Khronos), 3.5 and 3.10.
"""

import math
from pathlib import Path
from typing import Any

from focusjax.scene import gltf_json, gltf_world
from focusjax.scene_files._stored_camera import Opening, SceneFileError, StoredCamera, chosen, rigid


def gltf_camera(path: Path, name: str | None) -> StoredCamera:
    """The camera; see `read_camera`."""
    content = gltf_json(path)
    if not isinstance(content, dict):
        raise SceneFileError(f"{path}: is no glTF file that can be read; export it again")
    try:
        return _camera(content, path, name)
    except SceneFileError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        reason = str(error) if type(error) is ValueError else f"{type(error).__name__}: {error}"
        raise SceneFileError(f"{path}: is no valid glTF file ({reason}); export it again") from None


def _camera(content: dict[str, Any], path: Path, name: str | None) -> StoredCamera:
    nodes = content.get("nodes", [])
    cameras = content.get("cameras", [])
    placed = [number for number, node in enumerate(nodes) if "camera" in node]
    names = [_name(nodes[number], cameras[nodes[number]["camera"]], number) for number in placed]
    number = placed[chosen(names, name, path)]
    called = names[placed.index(number)]
    camera = cameras[nodes[number]["camera"]]
    if camera.get("type") != "perspective":
        raise SceneFileError(
            f"{path}: camera {called!r} is {camera.get('type')!s}; expected one in perspective"
        )
    pose = rigid(gltf_world(nodes, number), path, called)
    angle = float(camera["perspective"]["yfov"])
    if not 0 < angle < math.pi:
        raise SceneFileError(f"{path}: camera {called!r} has yfov = {angle:g}; expected 0 to pi")
    own = camera.get("extras", {})
    own = own.get("focusjax") if isinstance(own, dict) else None
    if not isinstance(own, dict):
        return StoredCamera(called, pose, field_of_view=angle)
    return StoredCamera(
        called,
        pose,
        focal_length=float(own["focal_length_m"]),
        sensor_width=float(own["sensor_width_m"]),
        resolution=(int(own["width_px"]), int(own["height_px"])),
        # "inf", as JSON has no word for it.
        focus_distance=float(own["focus_distance_m"]),
        f_number=0.0 if not own["aperture_radius_m"] else float(own["f_number"]),
        tilt=float(own["tilt_rad"]),
        swing=float(own["swing_rad"]),
        opening=_opening(own),
    )


def _opening(own: dict[str, Any]) -> Opening:
    blades = int(own.get("blades", 0))
    if not blades:
        return Opening(squeeze=float(own["squeeze"]))
    return Opening(blades, float(own["blade_rotation_rad"]), float(own["roundness"]), float(own["squeeze"]))


def _name(node: dict[str, Any], camera: dict[str, Any], number: int) -> str:
    return str(node.get("name") or camera.get("name") or f"node {number}")
