"""Cameras of USD: UsdGeomCamera, read by usd-core.

Its focal length and apertures are in tenths of a scene unit, its focus distance in scene units, an fStop of 0
means no blur, and a focus distance of 0 that nobody set one. Source: the documentation of UsdGeomCamera
(openusd.org).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from focusjax.scene_files._stored import CameraFrames, Opening, SceneFileError, StoredCamera, chosen, rigid
from focusjax.scene_files._usd_stage import object_names, open_stage, pxr, stage_frames, world_of

_FAR = 1e6
"""Metres from which on a focus distance is infinite; USD has no infinity, and `export_camera` writes this."""


def usd_camera_frames(
    path: Path, name: str | None, within: Sequence[Path], *, first_only: bool = False
) -> CameraFrames:
    """The camera in every frame, or in the first alone; see `read_camera_frames`."""
    stage = open_stage(path, within)
    prim, called = _chosen(stage, path, name)
    frames = stage_frames(stage)
    codes = frames.codes[:1] if first_only else frames.codes
    return CameraFrames(tuple(_at(stage, prim, called, code, path) for code in codes), frames.fps)


def _chosen(stage: Any, path: Path, name: str | None) -> tuple[Any, str]:
    """The camera that is meant, and what it is called."""
    Usd, UsdGeom = pxr(path, "Usd", "UsdGeom")
    # Instances are looked into: what they hold stands where they do.
    prims = [each for each in stage.Traverse(Usd.TraverseInstanceProxies()) if each.IsA(UsdGeom.Camera)]
    names = object_names(prims)
    own = [each.GetName() for each in prims]
    if name is not None and name not in names and own.count(name) == 1:
        return prims[own.index(name)], name
    number = chosen(names, name, path)
    return prims[number], names[number]


def _at(stage: Any, prim: Any, called: str, code: float, path: Path) -> StoredCamera:
    """The camera at one time code."""
    Usd, UsdGeom = pxr(path, "Usd", "UsdGeom")
    seen = UsdGeom.Camera(prim).GetCamera(Usd.TimeCode(code))
    if seen.projection != seen.Perspective:
        raise SceneFileError(f"{path}: camera {called!r} is orthographic; expected one in perspective")
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    sizes = {"focalLength": seen.focalLength, "horizontalAperture": seen.horizontalAperture}
    for key, value in sizes.items():
        if not 0 < value < np.inf:
            raise SceneFileError(f"{path}: camera {called!r} has {key} = {value:g}; expected more than 0")
    focus, stop = seen.focusDistance * unit, seen.fStop
    return StoredCamera(
        called,
        rigid(world_of(seen.transform, stage), path, called),
        focal_length=seen.focalLength * unit / 10,
        sensor_width=seen.horizontalAperture * unit / 10,
        shift=seen.horizontalApertureOffset * unit / 10,
        rise=seen.verticalApertureOffset * unit / 10,
        resolution=_pair(_own(prim, "resolution")),
        focus_distance=None if not focus > 0 else (focus if focus < _FAR else np.inf),
        f_number=stop if np.isfinite(stop) and stop >= 0 else None,
        opening=_opening(prim),
    )


def _own(prim: Any, key: str) -> Any:
    """An attribute that focusjax wrote."""
    attribute = prim.GetAttribute(f"focusjax:{key}")
    return attribute.Get() if attribute else None


def _pair(value: Any) -> tuple[int, int] | None:
    return None if value is None else (int(value[0]), int(value[1]))


def _opening(prim: Any) -> Opening | None:
    if _own(prim, "resolution") is None:
        return None
    return Opening(
        int(_own(prim, "blades") or 0),
        float(_own(prim, "bladeRotation") or 0.0),
        float(_own(prim, "bladeRoundness") or 0.0),
        float(_own(prim, "squeeze") or 1.0),
    )
