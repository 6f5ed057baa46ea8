"""Nodes and extensions of glTF 2.0: where each node stands, what is read, and what is said of the rest.

Source: the specification, 3.5 and 3.12.
"""

import json
import struct
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax._words import listed

_CHUNK = 8
_HEADER = 12
_READ = {
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
}
_LOST = {
    "EXT_mesh_gpu_instancing": "every mesh is shown once, where its node is",
    "KHR_materials_emissive_strength": "no surface sends out more than its emissive factor",
    "KHR_materials_transmission": "glass is shown as an opaque surface",
    "KHR_materials_unlit": "unlit materials are lit",
    "KHR_node_visibility": "hidden nodes are shown",
}
"""What an extension that a file can do without changes in the picture, where it is not read."""
_SAID = 4
"""Names that a warning lists."""


def gltf_parents(nodes: list[dict[str, Any]]) -> dict[int, int]:
    """The parent of every node that has one.

    Raises:
        ValueError: a node with two parents, or one that is its own ancestor.
    """
    above: dict[int, int] = {}
    for parent, node in enumerate(nodes):
        for child in node.get("children", ()):
            if not (isinstance(child, int) and 0 <= child < len(nodes)):
                raise ValueError(f"node {parent} has a child {child!r}, which is no node")
            if child in above:
                raise ValueError(f"node {child} has two parents, {above[child]} and {parent}")
            above[child] = parent
    settled: set[int] = set()
    for first in above:
        number, seen = first, set()
        while number in above and number not in settled:
            if number in seen:
                raise ValueError(f"node {number} is its own ancestor")
            seen.add(number)
            number = above[number]
        settled |= seen
    return above


def gltf_world(nodes: list[dict[str, Any]], number: int) -> Float[np.ndarray, "4 4"]:
    """World_from_node [4, 4] of one node, in metres.

    Raises:
        ValueError: as `gltf_parents`; or numbers that are no transform, or not finite.
    """
    above = gltf_parents(nodes)
    matrix = _local(nodes, number)
    while number in above:
        number = above[number]
        matrix = _local(nodes, number) @ matrix
    return matrix


def check_gltf_place(nodes: list[dict[str, Any]], number: int) -> None:
    """Refuse a node that is nowhere.

    Raises:
        ValueError: its transform is not finite.
    """
    node = nodes[number]
    for key in ("matrix", "translation", "rotation", "scale"):
        if key in node and not np.isfinite(np.asarray(node[key], dtype=float)).all():
            raise ValueError(f"node {node.get('name', number)} has a {key} that is not finite")


def _local(nodes: list[dict[str, Any]], number: int) -> Float[np.ndarray, "4 4"]:
    check_gltf_place(nodes, number)
    node = nodes[number]
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    turn = Rotation.from_quat(node.get("rotation", (0.0, 0.0, 0.0, 1.0))).as_matrix()
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=float)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def gltf_node_names(content: dict[str, Any]) -> list[str]:
    """A name for every node: its own or its mesh's, with a number where others have it too."""
    meshes = content.get("meshes", [])
    taken: set[str] = set()
    found = []
    for number, node in enumerate(content.get("nodes", [])):
        mesh = node.get("mesh")
        called = node.get("name") or (meshes[mesh].get("name") if mesh is not None else None)
        name = base = str(called or f"node {number}")
        count = 1
        while name in taken:
            count += 1
            name = f"{base} {count}"
        taken.add(name)
        found.append(name)
    return found


def gltf_for_trimesh(path: Path, content: dict[str, Any]) -> bytes:
    """The file as trimesh reads all of its meshes: nodes are named by their numbers, and have no cameras.

    trimesh leaves out a node with a camera, and so loses the place of what is below.
    """
    nodes = [
        {**{key: value for key, value in node.items() if key != "camera"}, "name": str(number)}
        for number, node in enumerate(content.get("nodes", []))
    ]
    text = json.dumps({**content, "nodes": nodes} if nodes else content).encode()
    if path.suffix.lower() == ".gltf":
        return text
    data = path.read_bytes()
    rest = data[_HEADER + _CHUNK + struct.unpack_from("<I", data, _HEADER)[0] :]
    text += b" " * (-len(text) % 4)
    version = struct.unpack_from("<I", data, 4)[0]
    whole = struct.pack("<4sII", data[:4], version, _HEADER + _CHUNK + len(text) + len(rest))
    return whole + struct.pack("<I4s", len(text), data[_HEADER + 4 : _HEADER + 8]) + text + rest


def check_extensions(path: Path, content: dict[str, Any]) -> None:
    """Refuse a file that nobody can read without extensions that are not read here.

    Raises:
        ValueError: there are such extensions.

    Warns:
        UserWarning: the picture will differ by extensions that are not read.
    """
    required = _names(content.get("extensionsRequired"))
    unread = sorted(required - _READ)
    if unread:
        which, them = ("an extension", "it") if len(unread) == 1 else ("extensions", "them")
        raise ValueError(
            f"mesh file {path} requires {listed(unread)}, {which} of glTF not read here; export the scene"
            f" again without {them}"
        )
    used = _names(content.get("extensionsUsed"))
    for node in content.get("nodes", []):
        used |= set(node.get("extensions", {}))
    for name in sorted(used & set(_LOST)):
        warnings.warn(
            f"mesh file {path} uses {name}, which is not read, so that {_LOST[name]}; export the scene"
            " without it if that shows",
            stacklevel=5,
        )


def say_what_moves(path: Path, content: dict[str, Any]) -> None:
    """Warn of meshes that skins or morph targets deform, whose shapes are taken as they were modelled."""
    nodes, meshes = content.get("nodes", []), content.get("meshes", [])
    named = [(name, node) for name, node in zip(gltf_node_names(content), nodes, strict=True)]
    named = [(name, node) for name, node in named if "mesh" in node]
    skinned = [name for name, node in named if "skin" in node]
    morphed = [
        name
        for name, node in named
        if np.any(np.asarray(node.get("weights", meshes[node["mesh"]].get("weights", ())), dtype=float))
    ]
    for found, what in ((skinned, "skeletons"), (morphed, "morph targets")):
        if found:
            warnings.warn(
                f"mesh file {path}: the {what} that deform {_some(found)} are not read, so that shapes are as"
                " they were modelled; export them deformed",
                stacklevel=5,
            )


def _names(value: object) -> set[str]:
    return {each for each in value if isinstance(each, str)} if isinstance(value, list) else set()


def _some(names: Sequence[str]) -> str:
    more = len(names) - _SAID
    return listed([*names[:_SAID], f"{more} more"] if more > 0 else names)
