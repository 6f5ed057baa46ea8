"""Extensions of glTF 2.0: which are read, and what is said of the others. Source: the specification, 3.12."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from focusjax._words import listed
from focusjax.scene._gltf import gltf_node_names

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
