"""Stages of USD: opened by usd-core, in metres with +y up, and frame by frame."""

import dataclasses
import importlib
import re
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.scene_files._stored import SceneFileError

_LONGEST = 300
"""Characters of a remark of USD's that a message has room for."""
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""From a world with +z up to one with +y up."""


def pxr(path: Path, *names: str) -> tuple[Any, ...]:
    """Modules of usd-core, which come without types.

    Raises:
        SceneFileError: it is not installed.
    """
    try:
        return tuple(importlib.import_module(f"pxr.{name}") for name in names)
    except ImportError:
        raise SceneFileError(
            f"{path}: is read by usd-core, which is not installed; install it with: pip install"
            " 'focusjax[usd]'"
        ) from None


def open_stage(path: Path, within: Sequence[Path]) -> Any:
    """The stage in a file.

    Raises:
        SceneFileError: it cannot be read, is put together from files outside `within`, includes itself, has a
            scene unit of no length, or is a package that holds compressed or damaged files.

    Warns:
        Layers and references that cannot be found or read.
    """
    Tf, Usd, UsdUtils = pxr(path, "Tf", "Usd", "UsdUtils")
    if path.suffix.lower() == ".usdz":
        _check_package(path)
    # USD would write its remarks to the terminal.
    remarks = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise SceneFileError(
            f"{path}: cannot be read as USD ({_first_line(error)}); export it again"
        ) from None
    for layer in stage.GetUsedLayers():
        if layer.realPath:
            refuse_outside(layer.realPath, path, within)
    _refuse_cycles(stage, path)
    _refuse_unit(stage, path)
    for each in remarks.TakeUncoalescedDiagnostics():
        said = _without_types(each.commentary.partition(" (instantiating")[0])
        warnings.warn(f"{path}: {said}; what is missing is left out, so check its paths", stacklevel=4)
    return stage


def refuse_outside(found: str, path: Path, within: Sequence[Path]) -> None:
    """A file, perhaps inside a package, that a stage refers to elsewhere.

    Raises:
        SceneFileError: it is not in one of the folders, nor in the stage's own file.
    """
    file = Path(found.partition("[")[0]).resolve()
    if file != path.resolve() and not any(file.is_relative_to(folder.resolve()) for folder in within):
        raise SceneFileError(
            f"{path}: refers to {file}, outside the folders that may be read; move it there, or allow more"
            " with --root DIR, or within=[DIR] in Python"
        )


def _refuse_cycles(stage: Any, path: Path) -> None:
    """What includes itself has no end: USD leaves out a part of it, of which nobody knows what was meant."""
    (Pcp,) = pxr(path, "Pcp")
    kinds = {Pcp.ErrorType_SublayerCycle: "sublayer", Pcp.ErrorType_ArcCycle: "reference"}
    for error in stage.GetCompositionErrors():
        if error.errorType in kinds:
            kind, site = kinds[error.errorType], error.rootSite.path
            where = "" if site == site.absoluteRootPath else f" at {site}"
            raise SceneFileError(
                f"{path}: includes itself by a {kind}{where}; remove that {kind}, or export the scene again"
            )


def _refuse_unit(stage: Any, path: Path) -> None:
    UsdGeom = importlib.import_module("pxr.UsdGeom")
    unit = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not 0 < unit < np.inf:
        raise SceneFileError(
            f"{path}: metersPerUnit is {unit:g}; expected a positive number, so set it to 1 where the scene"
            " is in metres, or to 0.01 for centimetres"
        )


def _check_package(path: Path) -> None:
    """USD maps packages as they are: a file in one that is compressed, or larger than all of it, is none."""
    try:
        with zipfile.ZipFile(path) as package:
            held = package.infolist()
    except (zipfile.BadZipFile, OSError) as error:
        raise SceneFileError(f"{path}: is no whole usdz package ({error}); export it again") from None
    packed = [each.filename for each in held if each.compress_type != zipfile.ZIP_STORED]
    if packed:
        raise SceneFileError(
            f"{path}: holds {packed[0]} compressed, which no usdz package does; pack it again with usdzip"
        )
    if sum(each.file_size for each in held) > path.stat().st_size:
        raise SceneFileError(f"{path}: claims to hold more than its own size; export it again")


@dataclasses.dataclass(frozen=True)
class StageFrames:
    """The frames of a stage.

    Attributes:
        codes: USD's time code of each; of one that does not move the first alone.
        fps: frames per second.
    """

    codes: tuple[float, ...]
    fps: float


def stage_frames(stage: Any) -> StageFrames:
    """Frames from the stage's first to its last time code; one where it has no range."""
    fps = float(stage.GetFramesPerSecond())
    if not stage.HasAuthoredTimeCodeRange():
        return StageFrames((0.0,), fps)
    first, last = float(stage.GetStartTimeCode()), float(stage.GetEndTimeCode())
    step = float(stage.GetTimeCodesPerSecond()) / fps
    count = max(1, int(np.floor((last - first) / step + 1e-6)) + 1)
    return StageFrames(tuple(first + k * step for k in range(count)), fps)


def world_of(transform: Any, stage: Any) -> Float[np.ndarray, "4 4"]:
    """World_from_local [4, 4] of USD's matrix for row vectors: from scene units to metres with +y up."""
    UsdGeom = importlib.import_module("pxr.UsdGeom")
    matrix = np.array(transform, dtype=float).T
    matrix[:3] *= UsdGeom.GetStageMetersPerUnit(stage)
    return _Y_UP @ matrix if UsdGeom.GetStageUpAxis(stage) == "Z" else matrix


def object_names(prims: Sequence[Any]) -> list[str]:
    """What prims are called: by the end of their path, or all of it where several end alike.

    Where a shape has no place of its own, but is all that its parent places, as Blender and Maya write
    objects and their data, the path is that of the parent.
    """
    paths = [str((prim.GetParent() if _is_data(prim) else prim).GetPath()) for prim in prims]
    last = [path.rpartition("/")[2] for path in paths]
    return [end if last.count(end) == 1 else path for end, path in zip(last, paths, strict=True)]


def _is_data(prim: Any) -> bool:
    """Whether a prim is the one shape of a parent that has its place."""
    UsdGeom = importlib.import_module("pxr.UsdGeom")
    parent = prim.GetParent()
    above, own = UsdGeom.Xformable(parent), UsdGeom.Xformable(prim)
    if not parent.IsA(UsdGeom.Xform) or own.GetOrderedXformOps() or not above.GetOrderedXformOps():
        return False
    return len([child for child in parent.GetAllChildren() if not child.IsA(UsdGeom.Xform)]) == 1


def _first_line(error: Exception) -> str:
    """What went wrong, without where in USD's own sources that was found."""
    line = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
    said = line.rpartition(" : '")[2].rstrip("'") if line.startswith("Error in '") else line
    return _without_types(said)


def _without_types(said: str) -> str:
    """A parser's remark without the types in USD's own sources of what it expected."""
    plain = re.sub(r" matching \S*pxrInternal.*?(?= at '|$)", "", said, flags=re.DOTALL)
    return plain if len(plain) <= _LONGEST else plain[:_LONGEST] + "..."
