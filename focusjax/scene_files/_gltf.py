"""glTF 2.0: cameras, a mesh for each node that has one, and lights of KHR_lights_punctual.

glTF's units and axes are focusjax's. A camera is a node's place in the hierarchy and a vertical field of
view; its lens is in `extras`, under "focusjax", where focusjax wrote the file. Directional lights have an
illuminance in lux, point lights an intensity in candela (lumen per steradian); a white Lambert surface that
faces them shows 1/pi of it. Sources: the specification of glTF 2.0 (Khronos), 3.5 and 3.10; the extension's
README.
"""

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from focusjax._words import listed
from focusjax.scene import (
    AbstractLight,
    directional_light,
    gltf_json,
    gltf_node_names,
    gltf_world,
    load_objects,
    point_light,
)
from focusjax.scene_files._stored import Opening, SceneFileError, StoredCamera, StoredScene, chosen, rigid

_LIGHTS = "KHR_lights_punctual"


def gltf_camera(path: Path, name: str | None) -> StoredCamera:
    """The camera; see `read_camera`."""
    content = _content(path)
    try:
        return _camera(content, path, name)
    except SceneFileError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        reason = str(error) if type(error) is ValueError else f"{type(error).__name__}: {error}"
        raise SceneFileError(f"{path}: is no valid glTF file ({reason}); export it again") from None


def _content(path: Path) -> dict[str, Any]:
    content = gltf_json(path)
    if not isinstance(content, dict):
        raise SceneFileError(f"{path}: is no glTF file that can be read; export it again")
    return content


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


def gltf_scene(path: Path, within: Sequence[Path]) -> StoredScene:
    """The scene; see `read_scene`."""
    content = _content(path)
    try:
        objects = load_objects(path, within=within)
    except ValueError as error:
        raise SceneFileError(str(error)) from error
    try:
        lights = _lights(content, path)
    except SceneFileError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise SceneFileError(f"{path}: has lights that cannot be read ({reason}); export it again") from None
    if content.get("animations"):
        warnings.warn(
            f"{path}: has animations, which are not read; objects stand where their nodes do", stacklevel=3
        )
    return StoredScene(objects, lights)


def _lights(content: dict[str, Any], path: Path) -> tuple[AbstractLight, ...]:
    kinds = content.get("extensions", {}).get(_LIGHTS, {}).get("lights", [])
    nodes = content.get("nodes", [])
    names = gltf_node_names(content)
    found: list[AbstractLight] = []
    spots = []
    for number, node in enumerate(nodes):
        said = node.get("extensions", {}).get(_LIGHTS)
        if said is None:
            continue
        index = said["light"]
        if not (isinstance(index, int) and 0 <= index < len(kinds)):
            raise SceneFileError(
                f"{path}: {names[number]} has light {index!r}, and the file has {len(kinds)} lights; export"
                " the scene again"
            )
        light = kinds[index]
        colour = np.array(light.get("color", (1.0, 1.0, 1.0)), dtype=float)
        shown = colour * float(light.get("intensity", 1.0)) / math.pi
        world = gltf_world(nodes, number)
        if light["type"] == "directional":
            found.append(directional_light(-world[:3, 2], shown))
        elif light["type"] == "point":
            found.append(point_light(world[:3, 3], shown))
        else:
            spots.append(names[number])
    if spots:
        warnings.warn(
            f"{path}: {listed(spots)} {'is a spot light' if len(spots) == 1 else 'are spot lights'}, which"
            " are left out; make them point or directional lights",
            stacklevel=4,
        )
    return tuple(found)
