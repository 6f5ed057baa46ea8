"""Scenes of USD: meshes with their materials, lights, and what moves as one over the frames."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax._words import listed
from focusjax.scene import SceneObject, TextureTable, moved_part, object_of_parts
from focusjax.scene_files._stored import SceneFileError, StoredScene
from focusjax.scene_files._usd_lights import usd_lights
from focusjax.scene_files._usd_material import Looks
from focusjax.scene_files._usd_mesh import usd_parts
from focusjax.scene_files._usd_stage import object_names, open_stage, pxr, stage_frames, world_of

_SAID = 4
"""Names that a warning lists."""


def usd_scene(path: Path, within: Sequence[Path]) -> StoredScene:
    """The scene; see `read_scene`."""
    Usd, UsdGeom, UsdLux = pxr(path, "Usd", "UsdGeom", "UsdLux")
    stage = open_stage(path, within)
    frames = stage_frames(stage)
    code = frames.codes[0]
    shown = _shown(stage, code, Usd, UsdGeom)
    _refuse_instancers(shown, path, UsdGeom)
    meshes = [prim for prim in shown if prim.IsA(UsdGeom.Mesh)]
    _say_what_is_left(shown, meshes, path, UsdGeom)
    textures = TextureTable(source=str(path), find=_nothing)
    looks = Looks(path, within, textures)
    objects: dict[str, SceneObject] = {}
    placed: dict[str, Any] = {}
    for prim, name in zip(meshes, object_names(meshes), strict=True):
        world = _world(prim, code, stage, path)
        try:
            parts = [moved_part(part, world) for part in usd_parts(prim, code, looks, path)]
            if parts:
                objects[name] = object_of_parts(
                    name, parts, textures.pictures, textures.opacities, f"{path}: mesh {prim.GetPath()}"
                )
                placed[name] = prim
        except SceneFileError:
            raise
        except ValueError as error:
            raise SceneFileError(str(error)) from error
    if not objects:
        raise SceneFileError(f"{path}: has no meshes to be seen; export the scene with them")
    lit = [prim for prim in shown if prim.HasAPI(UsdLux.LightAPI)]
    lights, ambient, background = usd_lights(stage, lit, code, path, within)
    motions = {
        name: motion
        for name, prim in placed.items()
        if (motion := _motion(prim, frames.codes, stage, path)) is not None
    }
    return StoredScene(
        tuple(objects.values()), lights, ambient, background, motions, len(frames.codes), frames.fps
    )


def _nothing(name: str) -> bytes:
    raise FileNotFoundError(name)


def _shown(stage: Any, code: float, Usd: Any, UsdGeom: Any) -> list[Any]:
    """Prims that are to be rendered, those within instances too."""
    time, found = Usd.TimeCode(code), []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        able = UsdGeom.Imageable(prim)
        if not able or able.ComputeVisibility(time) == UsdGeom.Tokens.invisible:
            continue
        if able.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render):
            found.append(prim)
    return found


def _refuse_instancers(shown: Sequence[Any], path: Path, UsdGeom: Any) -> None:
    for prim in shown:
        if prim.IsA(UsdGeom.PointInstancer):
            raise SceneFileError(
                f"{path}: {prim.GetPath()} places instances at points, which are not read; make the instances"
                " real (meshes of their own), and export again"
            )


def _say_what_is_left(shown: Sequence[Any], meshes: Sequence[Any], path: Path, UsdGeom: Any) -> None:
    """Warn of shapes that are no meshes, of subdivision, and of skeletons."""
    others = [prim for prim in shown if prim.IsA(UsdGeom.Gprim) and not prim.IsA(UsdGeom.Mesh)]
    if others:
        warnings.warn(
            f"{path}: only meshes are read; left out: {_some(others)}, so convert to meshes",
            stacklevel=4,
        )
    smooth = [
        prim for prim in meshes if UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr().Get() not in ("none", None)
    ]
    if smooth:
        warnings.warn(
            f"{path}: subdivision is not read, and polygons are shown as they are, of {_some(smooth)}; export"
            " them subdivided if corners show",
            stacklevel=4,
        )
    boned = [prim for prim in meshes if prim.GetRelationship("skel:skeleton").GetTargets()]
    if boned:
        warnings.warn(
            f"{path}: the skeleton that moves {_some(boned)} is not read, so that shapes are as they were"
            " modelled; export them deformed",
            stacklevel=4,
        )


def _some(prims: Sequence[Any]) -> str:
    names = [f"{prim.GetName()} ({prim.GetTypeName()})" for prim in prims[:_SAID]]
    more = len(prims) - _SAID
    return listed([*names, f"{more} more"] if more > 0 else names)


def _world(prim: Any, code: float, stage: Any, path: Path) -> Float[np.ndarray, "4 4"]:
    Usd, UsdGeom = pxr(path, "Usd", "UsdGeom")
    place = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode(code))
    if not np.isfinite(np.array(place, dtype=float)).all():
        raise SceneFileError(f"{path}: the transform of {prim.GetPath()} is not finite; place it anew")
    return world_of(place, stage)


def _motion(prim: Any, codes: Sequence[float], stage: Any, path: Path) -> Float[np.ndarray, "f 4 4"] | None:
    """Where a mesh is in every frame; None for one that stands still."""
    if len(codes) == 1 or not _may_move(prim):
        return None
    matrices = np.stack([_world(prim, code, stage, path) for code in codes])
    if np.array_equal(matrices, np.broadcast_to(matrices[0], matrices.shape)):
        return None
    return matrices


def _may_move(prim: Any) -> bool:
    UsdGeom = pxr(Path(), "UsdGeom")[0]
    while prim:
        able = UsdGeom.Xformable(prim)
        if able and able.TransformMightBeTimeVarying():
            return True
        prim = prim.GetParent()
    return False
