"""Cameras of USD: UsdGeomCamera, read by usd-core.

Its focal length and apertures are in tenths of a scene unit, its focus distance in scene units, an fStop of 0
means no blur, and a focus distance of 0 that nobody set one. Matrices act on row vectors. Source: the
documentation of UsdGeomCamera (openusd.org).
"""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.camera_files._stored import CameraFileError, Opening, StoredCamera, chosen, rigid

_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""From a world with +z up to one with +y up."""
_FAR = 1e6
"""Metres from which on a focus distance is infinite; USD has no infinity, and `export_camera` writes this."""


def usd_camera(path: Path, name: str | None, within: Sequence[Path] | None) -> StoredCamera:
    """The camera; see `read_camera`."""
    try:
        # Its modules come without types.
        Tf, Usd, UsdGeom = (importlib.import_module(f"pxr.{name}") for name in ("Tf", "Usd", "UsdGeom"))
    except ImportError:
        raise CameraFileError(
            f"{path}: is read by usd-core, which is not installed; install it with: pip install"
            " 'focusjax[usd]'"
        ) from None
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise CameraFileError(
            f"{path}: cannot be read as USD ({_first_line(error)}); export it again"
        ) from None
    _refuse_outside(stage, path, within)
    # Instances are looked into: what they hold stands where they do.
    prims = [each for each in stage.Traverse(Usd.TraverseInstanceProxies()) if each.IsA(UsdGeom.Camera)]
    names = _names([str(each.GetPath()) for each in prims])
    number = chosen(names, name, path)
    prim, called = prims[number], names[number]
    time = Usd.TimeCode(stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else Usd.TimeCode(0)
    seen = UsdGeom.Camera(prim).GetCamera(time)
    if seen.projection != seen.Perspective:
        raise CameraFileError(f"{path}: camera {called!r} is orthographic; expected one in perspective")
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    sizes = {"focalLength": seen.focalLength, "horizontalAperture": seen.horizontalAperture}
    for key, value in sizes.items():
        if not 0 < value < np.inf:
            raise CameraFileError(f"{path}: camera {called!r} has {key} = {value:g}; expected more than 0")
    focus, stop = seen.focusDistance * unit, seen.fStop
    return StoredCamera(
        called,
        rigid(_pose(np.array(seen.transform), unit, UsdGeom.GetStageUpAxis(stage)), path, called),
        focal_length=seen.focalLength * unit / 10,
        sensor_width=seen.horizontalAperture * unit / 10,
        shift=seen.horizontalApertureOffset * unit / 10,
        rise=seen.verticalApertureOffset * unit / 10,
        resolution=_pair(_own(prim, "resolution")),
        focus_distance=None if not focus > 0 else (focus if focus < _FAR else np.inf),
        f_number=stop if np.isfinite(stop) and stop >= 0 else None,
        opening=_opening(prim),
    )


def _pose(transform: Float[np.ndarray, "4 4"], unit: float, axis: str) -> Float[np.ndarray, "4 4"]:
    """World_from_camera in metres with +y up, of a transform of row vectors."""
    pose = transform.T.copy()
    pose[:3, 3] *= unit
    return _Y_UP @ pose if axis == "Z" else pose


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


def _names(paths: Sequence[str]) -> list[str]:
    """The last part of each path, or all of it where several end alike."""
    last = [path.rpartition("/")[2] for path in paths]
    return [end if last.count(end) == 1 else path for end, path in zip(last, paths, strict=True)]


def _refuse_outside(stage: Any, path: Path, within: Sequence[Path] | None) -> None:
    """A stage that is put together from files elsewhere."""
    if within is None:
        return
    folders = [folder.resolve() for folder in within]
    for layer in stage.GetUsedLayers():
        file = Path(layer.realPath).resolve() if layer.realPath else None
        if file is not None and not any(file.is_relative_to(folder) for folder in folders):
            raise CameraFileError(
                f"{path}: refers to {file}, outside the folders that may be read; move it there, or allow"
                " more with --root DIR"
            )


def _first_line(error: Exception) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
