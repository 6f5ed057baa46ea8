"""Scenes of glTF 2.0: a mesh for each node that has one, and lights of KHR_lights_punctual.

Directional lights have an illuminance in lux, point lights an intensity in candela (lumen per steradian); a
white Lambert surface that faces them shows 1/pi of it. Source: the extension's README (Khronos).
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
from focusjax.scene_files._stored_camera import SceneFileError
from focusjax.scene_files._stored_scene import StoredScene

_LIGHTS = "KHR_lights_punctual"


def gltf_scene(path: Path, within: Sequence[Path]) -> StoredScene:
    """The scene; see `read_scene`."""
    content = gltf_json(path)
    if not isinstance(content, dict):
        raise SceneFileError(f"{path}: is no glTF file that can be read; export it again")
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
