"""Meshes of USD as pieces of objects: polygons as fans of triangles, with colours, normals and pictures.

Source: the documentation of UsdGeomMesh and UsdGeomPrimvarsAPI (openusd.org).
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from focusjax.scene import Material, Part, check_part
from focusjax.scene_files._stored import SceneFileError
from focusjax.scene_files._usd_material import Look, Looks
from focusjax.scene_files._usd_stage import pxr

_GREY = 0.8
"""Linear grey of meshes without a colour."""
_IN_CORNERS, _IN_FACES, _ONCE = "faceVarying", "uniform", "constant"


@dataclasses.dataclass(frozen=True)
class Polygons:
    """A mesh as its file has it.

    Attributes:
        points: [p, 3] in the mesh's own space.
        counts: corners of each face [f].
        corners: point of each corner [c].
    """

    points: Float[np.ndarray, "p 3"]
    counts: Int[np.ndarray, "f"]
    corners: Int[np.ndarray, "c"]


def usd_parts(prim: Any, code: float, looks: Looks, path: Path) -> list[Part]:
    """The checked pieces of a mesh, one for each material, in its own space.

    Raises:
        SceneFileError: points that are animated, or faces that do not fit them.
    """
    Usd, UsdGeom = pxr(path, "Usd", "UsdGeom")
    mesh, time, what = UsdGeom.Mesh(prim), Usd.TimeCode(code), f"{path}: mesh {prim.GetPath()}"
    if mesh.GetPointsAttr().ValueMightBeTimeVarying():
        raise SceneFileError(
            f"{what} has animated points, which are not read; export the frame that you want alone"
        )
    shape = _polygons(mesh, time, what)
    if not len(shape.counts):
        return []
    pieces = []
    for faces, look in _by_material(prim, len(shape.counts), time, looks, UsdGeom):
        if len(faces):
            pieces.append(_piece(mesh, shape, faces, look, time, what))
    for piece in pieces:
        check_part(piece, what)
    return pieces


def _polygons(mesh: Any, time: Any, what: str) -> Polygons:
    points = mesh.GetPointsAttr().Get(time)
    counts, corners = mesh.GetFaceVertexCountsAttr().Get(time), mesh.GetFaceVertexIndicesAttr().Get(time)
    if points is None or counts is None or corners is None:
        return Polygons(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64))
    shape = Polygons(
        np.array(points, dtype=np.float64).reshape(-1, 3),
        np.array(counts, dtype=np.int64),
        np.array(corners, dtype=np.int64),
    )
    whole = (shape.counts >= 0).all() and shape.counts.sum() == len(shape.corners)
    if not whole or (
        len(shape.corners) and not 0 <= shape.corners.min() <= shape.corners.max() < len(points)
    ):
        raise SceneFileError(f"{what} has faces that do not fit its {len(points)} points; export it again")
    return shape


def _by_material(
    prim: Any, count: int, time: Any, looks: Looks, UsdGeom: Any
) -> list[tuple[Int[np.ndarray, "n"], Look | None]]:
    """Faces and their look: those of subsets, and what is left."""
    left = np.ones(count, dtype=bool)
    holes = UsdGeom.Mesh(prim).GetHoleIndicesAttr().Get(time)
    if holes is not None:
        left[[k for k in holes if 0 <= k < count]] = False
    found = []
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        if subset.GetFamilyNameAttr().Get() != "materialBind":
            continue
        faces = np.array(subset.GetIndicesAttr().Get(time) or (), dtype=np.int64)
        faces = faces[(faces >= 0) & (faces < count)]
        faces = np.unique(faces[left[faces]])
        left[faces] = False
        found.append((faces, looks.of(subset.GetPrim())))
    return [*found, (np.flatnonzero(left), looks.of(prim))]


def _piece(
    mesh: Any, shape: Polygons, faces: Int[np.ndarray, "n"], look: Look | None, time: Any, what: str
) -> Part:
    """Triangles of some faces, every corner a vertex of its own where corners differ."""
    first = np.cumsum(shape.counts) - shape.counts
    fans = np.maximum(shape.counts[faces] - 2, 0)
    owner = np.repeat(faces, fans)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(fans) - fans, fans)
    corner = np.stack([first[owner], first[owner] + step + 1, first[owner] + step + 2], axis=1)
    if mesh.GetOrientationAttr().Get() == "leftHanded":
        corner = corner[:, ::-1]
    uv = None if look is None or not look.uv else _primvar(mesh, look.uv, shape, time, what)
    if uv is not None and look is not None and look.transform is not None:
        uv = np.concatenate([uv[:, :2], np.ones((len(uv), 1))], axis=1) @ look.transform.T
    name = "displayColor" if look is None else look.colours
    colours = _primvar(mesh, name, shape, time, what) if name else None
    normals = _normals(mesh, shape, time, what)
    used = corner.ravel()
    material = Material(np.full(3, 1.0 if colours is not None else _GREY), np.zeros(3), np.zeros(3))
    if look is not None:
        material = look.material
        if material.texture >= 0 and uv is None:
            material = dataclasses.replace(material, texture=-1, opacity_texture=-1)

    def taken(values: np.ndarray | None, width: int) -> np.ndarray | None:
        return None if values is None else np.asarray(values, dtype=np.float64)[used, :width]

    rgb = taken(colours, 3)
    return Part(
        vertices=shape.points[shape.corners[used]],
        faces=np.arange(len(used)).reshape(-1, 3),
        material=material,
        normals=taken(normals, 3),
        uv=taken(uv, 2),
        colours=None if rgb is None else np.maximum(rgb, 0.0),
    )


def _normals(mesh: Any, shape: Polygons, time: Any, what: str) -> Float[np.ndarray, "c 3"] | None:
    """Normals of corners; None for those of a subdivision surface, which mean nothing."""
    if mesh.GetSubdivisionSchemeAttr().Get() != "none":
        return None
    found = _primvar(mesh, "normals", shape, time, what)
    if found is not None:
        return found
    values = mesh.GetNormalsAttr().Get(time)
    if values is None or not len(values):
        return None
    return _spread(np.array(values, dtype=float), mesh.GetNormalsInterpolation(), shape, what, "normals")


def _primvar(mesh: Any, name: str, shape: Polygons, time: Any, what: str) -> np.ndarray | None:
    """A primvar's values at all corners [c, n]; None where the mesh has none."""
    UsdGeom = pxr(Path(what), "UsdGeom")[0]
    variable = UsdGeom.PrimvarsAPI(mesh.GetPrim()).FindPrimvarWithInheritance(name)
    if not variable or not variable.HasValue():
        return None
    values = np.array(variable.ComputeFlattened(time), dtype=float)
    if values.ndim != 2 or not len(values):
        return None
    return _spread(values, variable.GetInterpolation(), shape, what, name)


def _spread(values: np.ndarray, kind: str, shape: Polygons, what: str, name: str) -> np.ndarray:
    """Values of corners, from those of points, faces, corners, or one for all."""
    index: np.ndarray | Sequence[int]
    if kind == _IN_CORNERS:
        index = np.arange(len(shape.corners))
    elif kind == _IN_FACES:
        index = np.repeat(np.arange(len(shape.counts)), shape.counts)
    elif kind == _ONCE:
        index = np.zeros(len(shape.corners), dtype=np.int64)
    else:
        index = shape.corners
    if len(index) and max(index) >= len(values):
        raise SceneFileError(
            f"{what} has {len(values)} {name} of the kind {kind}, fewer than it needs; export it again"
        )
    return values[index]
