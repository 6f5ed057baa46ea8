"""Cameras for USD, as text (`.usda`): UsdGeomCamera.

Its focal length and apertures are in tenths of a scene unit, its focus distance in scene units, and an fStop
of 0 means no blur. Aperture offsets move the frame as focusjax's shift and rise do. Matrices act on row
vectors. Of the shape of the opening it has no word: that is said by attributes of our own (`focusjax:...`).
Source: the documentation of UsdGeomCamera (openusd.org).
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from focusjax.exchange._files import distance, identifier, number
from focusjax.exchange._record import Frame, Record
from focusjax.io import replace_file

Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""From a world with +y up to one with +z up, as other programs convert it."""


@dataclasses.dataclass(frozen=True)
class Stage:
    """The units and axes of a USD stage.

    Attributes:
        metres_per_unit: length of its unit.
        up_axis: "Y" or "Z".
        first_frame: time code of the first frame.
    """

    metres_per_unit: float = 1.0
    up_axis: str = "Y"
    first_frame: int = 1


def write_usd(record: Record, path: Path, stage: Stage | None = None) -> tuple[Path, ...]:
    """Write the camera as a stage of its own."""
    replace_file(path, usd_text(record, Stage() if stage is None else stage))
    return (path,)


def usd_text(record: Record, stage: Stage) -> str:
    """The stage's text."""
    name = identifier(record.name)
    last = stage.first_frame + len(record.frames) - 1
    lines = [
        "#usda 1.0",
        "(",
        f'    defaultPrim = "{name}"',
        f"    metersPerUnit = {number(stage.metres_per_unit)}",
        f'    upAxis = "{stage.up_axis}"',
    ]
    if record.is_shot:
        lines += [
            f"    startTimeCode = {stage.first_frame}",
            f"    endTimeCode = {last}",
            f"    timeCodesPerSecond = {number(record.fps)}",
            f"    framesPerSecond = {number(record.fps)}",
        ]
    lines += [")", "", f'def Camera "{name}"', "{"]
    for declared, value in _attributes(record, stage):
        lines += _attribute(record, stage, declared, value)
    lines += [
        '    token projection = "perspective"',
        f"    custom int2 focusjax:resolution = ({record.width}, {record.height})",
    ]
    if record.opening.blades:
        lines += [
            f"    custom int focusjax:blades = {record.opening.blades}",
            f"    custom double focusjax:bladeRotation = {number(record.opening.rotation)}",
            f"    custom double focusjax:bladeRoundness = {number(record.opening.roundness)}",
        ]
    if record.opening.squeeze != 1.0:
        lines.append(f"    custom double focusjax:squeeze = {number(record.opening.squeeze)}")
    lines += ['    uniform token[] xformOpOrder = ["xformOp:transform"]', "}", ""]
    return "\n".join(lines)


def _attributes(record: Record, stage: Stage) -> list[tuple[str, Callable[[Frame], str]]]:
    unit, tenth = stage.metres_per_unit, stage.metres_per_unit / 10.0
    share = record.height / record.width
    return [
        ("float2 clippingRange", lambda _: f"({number(0.01 / unit)}, {number(1e6 / unit)})"),
        ("float focalLength", lambda frame: number(frame.focal_length / tenth)),
        ("float focusDistance", lambda frame: number(distance(frame.focus_distance) / unit)),
        ("float fStop", lambda frame: number(frame.f_number if frame.aperture_radius else 0.0)),
        ("float horizontalAperture", lambda frame: number(frame.sensor_width / tenth)),
        ("float verticalAperture", lambda frame: number(frame.sensor_width * share / tenth)),
        ("float horizontalApertureOffset", lambda frame: number(frame.shift / tenth)),
        ("float verticalApertureOffset", lambda frame: number(frame.rise / tenth)),
        ("matrix4d xformOp:transform", lambda frame: _matrix(stage_pose(frame.pose, stage))),
    ]


def stage_pose(pose: Float[np.ndarray, "4 4"], stage: Stage) -> Float[np.ndarray, "4 4"]:
    """A pose in the units and axes of a stage, for column vectors."""
    placed = pose.copy()
    placed[:3, 3] /= stage.metres_per_unit
    return Z_UP @ placed if stage.up_axis == "Z" else placed


def _matrix(matrix: Float[np.ndarray, "4 4"]) -> str:
    rows = (", ".join(number(value + 0.0) for value in row) for row in matrix.T)
    return "( " + ", ".join(f"({row})" for row in rows) + " )"


def _attribute(record: Record, stage: Stage, declared: str, value: Callable[[Frame], str]) -> list[str]:
    """The lines of an attribute: one value, or one a frame where it changes."""
    values = [value(frame) for frame in record.frames]
    if len(set(values)) == 1:
        return [f"    {declared} = {values[0]}"]
    samples = (f"        {stage.first_frame + number}: {text}," for number, text in enumerate(values))
    return [f"    {declared}.timeSamples = {{", *samples, "    }"]
