"""Vertex attributes of glTF 2.0 that trimesh takes as they are stored: integers, and coordinates of pictures.

Integers that are normalised stand for 0 to 1, or -1 to 1. A material says which texture coordinates its
picture has, and KHR_texture_transform moves them. Source: the specification, 3.6.2.2 and 3.9.3, and the
READMEs of KHR_mesh_quantization and KHR_texture_transform (Khronos).
"""

import math
from typing import Any

import numpy as np
from jaxtyping import Float
from trimesh.exchange.gltf.extensions import register_handler

_OWN = "FOCUSJAX_attributes"
"""The name under which trimesh, which has no other way in, calls `_decoded` for each piece of a mesh."""


def with_attributes(content: dict[str, Any]) -> dict[str, Any]:
    """The file's JSON, in which each piece of a mesh says how its attributes are to be decoded.

    Raises:
        ValueError: a transform of texture coordinates that is none.
    """
    accessors, materials = content.get("accessors", []), content.get("materials", [])

    def marked(piece: dict[str, Any]) -> dict[str, Any]:
        attributes = piece.get("attributes", {})
        normalised = [
            name
            for name, number in attributes.items()
            if name.startswith("COLOR_") or (number < len(accessors) and accessors[number].get("normalized"))
        ]
        own: dict[str, Any] = {"normalised": normalised}
        if "material" in piece:
            own |= _picture(materials[piece["material"]])
        # Last, so that compressed attributes are there.
        return {**piece, "extensions": {**piece.get("extensions", {}), _OWN: own}}

    meshes = [
        {**mesh, "primitives": [marked(piece) for piece in mesh["primitives"]]}
        for mesh in content.get("meshes", [])
    ]
    return {**content, "meshes": meshes} if meshes else content


def _picture(material: dict[str, Any]) -> dict[str, Any]:
    """Which texture coordinates a material's base colour has, and the matrix [2, 3] that moves them."""
    gloss = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    usual = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
    info = gloss.get("diffuseTexture") or usual or {}
    moved = info.get("extensions", {}).get("KHR_texture_transform", {})
    (x, y), (across, down) = moved.get("offset", (0.0, 0.0)), moved.get("scale", (1.0, 1.0))
    angle = float(moved.get("rotation", 0.0))
    if not all(map(math.isfinite, (x, y, across, down, angle))):
        raise ValueError(f"KHR_texture_transform of material {material.get('name', '')!r} is not finite")
    cos, sin = math.cos(angle), math.sin(angle)
    matrix = [[cos * across, sin * down, x], [-sin * across, cos * down, y]]
    return {"uv": int(moved.get("texCoord", info.get("texCoord", 0))), "matrix": matrix}


@register_handler(_OWN, scope="primitive_preprocess")
def _decoded(context: Any) -> None:
    """Replace the numbers of one piece of a mesh, as `with_attributes` has it."""
    own, numbers = context["data"], context["accessors"]
    attributes: dict[str, int] = context["primitive"]["attributes"]
    for name, number in attributes.items():
        if name.startswith(("POSITION", "NORMAL", "TEXCOORD_", "COLOR_")):
            numbers[number] = _as_floats(numbers[number], normalised=name in own["normalised"])
    if "uv" not in own:
        return
    found = attributes.pop(f"TEXCOORD_{own['uv']}", None)
    attributes.pop("TEXCOORD_0", None)
    if found is not None:
        uv = np.asarray(numbers[found], dtype=np.float64)
        matrix = np.asarray(own["matrix"])
        attributes["TEXCOORD_0"] = len(numbers)
        numbers.append(uv[:, :2] @ matrix[:, :2].T + matrix[:, 2])


def _as_floats(values: np.ndarray, *, normalised: bool) -> Float[np.ndarray, "v _"]:
    """Integers as the numbers that they stand for; floats as they are."""
    if values.dtype.kind == "f":
        return values
    if not normalised:
        return values.astype(np.float64)
    return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
