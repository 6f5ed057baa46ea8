"""Cameras for other programs: from a lens, or from a config, to files."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from focusjax._arguments import ArgumentError, require_switches
from focusjax._words import did_you_mean, listed
from focusjax.exchange._blender import write_blender
from focusjax.exchange._fitting import Target, fitted_to
from focusjax.exchange._gltf import write_gltf
from focusjax.exchange._mitsuba import write_mitsuba
from focusjax.exchange._pbrt import write_pbrt
from focusjax.exchange._record import Record, record_of
from focusjax.exchange._usd import Stage, write_usd
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

_SHIFTS = ("shift", "fine shift")
TARGETS = {
    target.name: target
    for target in (
        Target("usd", "USD", ".usda", frozenset({*_SHIFTS, "opening"}), write_usd),
        Target(
            "blender",
            "Blender",
            ".py",
            frozenset({*_SHIFTS, "opening", "tilt", "surface"}),
            write_blender,
        ),
        Target("mitsuba", "Mitsuba", ".xml", frozenset({"shift"}), write_mitsuba),
        Target("pbrt", "pbrt", ".pbrt", frozenset({*_SHIFTS, "glass"}), write_pbrt),
        Target("gltf", "glTF", ".gltf", frozenset({"opening", "tilt"}), write_gltf),
    )
}
"""The programs and formats that cameras are written for, by name."""


@dataclasses.dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        files: in the order of frames, where there are several.
        remarks: one sentence for each thing that is approximated.
        blur_error_px: by how much the diameters of blur spots differ at most, in pixels.
        record: the camera as it was written, in plain numbers.
    """

    files: tuple[Path, ...]
    remarks: tuple[str, ...]
    blur_error_px: float
    record: Record

    @property
    def sentence(self) -> str:
        """What is approximated, and how well; empty where nothing is."""
        if not self.remarks:
            return ""
        said = listed(self.remarks)
        return f"Approximated: {said}; blur differs by up to {self.blur_error_px:.2g} px in diameter."

    @property
    def sentences(self) -> tuple[str, ...]:
        """What a person wants to know: what is approximated, and where the camera is."""
        first, last = self.files[0], self.files[-1]
        where = f"Camera: {first}" if first == last else f"Camera: {first} to {last.name}"
        return (self.sentence, where) if self.sentence else (where,)


def export_camera(
    camera: Camera | Sequence[Camera],
    lens: AbstractLens | Sequence[AbstractLens],
    path: str | Path,
    *,
    to: str,
    approximate: bool = False,
    name: str = "Camera",
    fps: float = 24.0,
    disparities: tuple[float, float] | Sequence[tuple[float, float]] | None = None,
    metres_per_unit: float = 1.0,
    up_axis: str = "Y",
) -> Exported:
    """Write a camera with its lens for another program.

    Args:
        camera: where from; a sequence for a shot, one a frame.
        lens: through what; as many as cameras.
        path: the file; its ending is the target's (`TARGETS`).
        to: "usd", "blender", "mitsuba", "pbrt" or "gltf".
        approximate: whether the nearest camera will do that the target can have.
        name: what the target is to call the camera.
        fps: frames per second of a shot.
        disparities: least and largest 1/m of what is seen, by which approximations are judged, one pair or
            one a frame; from infinity to half the focus distance when not given.
        metres_per_unit: of a USD stage.
        up_axis: of a USD stage, "Y" or "Z".

    Raises:
        ExportError: something that the target cannot say, and `approximate` is false; the message says where
            to export it instead.
        ArgumentError: another value that cannot be.

    Example:
        >>> camera = fj.look_at((0, 0, 1), (0, 0, 0), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=1.0, f_number=2.0, focal_length=0.05)
        >>> [file.name for file in fj.export_camera(camera, lens, "camera.usda", to="usd").files]
        ['camera.usda']
    """
    require_switches(approximate=approximate)
    stage = checked_stage(to, metres_per_unit, up_axis)
    record = record_of(camera, lens, name=name, fps=fps)
    seen = _pairs(disparities, len(record.frames))
    return write_record(record, Path(path), to, approximate=approximate, disparities=seen, stage=stage)


def checked_stage(to: str, metres_per_unit: float, up_axis: str) -> Stage:
    """The units and axes of a USD stage; other targets have their own.

    Raises:
        ArgumentError: what no stage has, or what the target leaves no choice of.
    """
    if not 0 < metres_per_unit < math.inf:
        raise ArgumentError(
            f"metres_per_unit is {metres_per_unit}; expected a length above 0", "metres_per_unit"
        )
    if up_axis not in ("Y", "Z"):
        raise ArgumentError(f"up_axis is {up_axis!r}; expected 'Y' or 'Z'", "up_axis")
    chosen = {"metres_per_unit": metres_per_unit != 1.0, "up_axis": up_axis != "Y"}
    for argument, differs in chosen.items():
        if differs and to != "usd":
            raise ArgumentError(
                f"{argument} is given for the target {to!r}, which has units and axes of its own; leave it"
                " out, it is for 'usd' alone",
                argument,
            )
    return Stage(float(metres_per_unit), up_axis)


def write_record(
    record: Record,
    path: Path,
    to: str,
    *,
    approximate: bool,
    disparities: Sequence[tuple[float, float]] | None,
    stage: Stage | None = None,
) -> Exported:
    """Write a record for a target; arguments are those of `export_camera`.

    Raises:
        ExportError: as `export_camera`.
        ArgumentError: an unknown target, another ending than the target's, or a folder that is none.
    """
    target = checked_target(to, path)
    fitted = fitted_to(record, target, TARGETS, approximate=approximate, disparities=disparities)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # USD's files have units and axes of their own.
        own = to == "usd"
        files = write_usd(fitted.record, path, stage) if own else target.write(fitted.record, path)
    except OSError as error:
        raise ArgumentError(
            f"{path} cannot be written ({error.strerror}); choose another file", "path"
        ) from error
    return Exported(files, fitted.remarks, fitted.blur_error_px, fitted.record)


def target_named(name: str) -> Target:
    """The target of that name.

    Raises:
        ArgumentError: there is none.
    """
    if name not in TARGETS:
        known = f"expected {', '.join(TARGETS)}"
        raise ArgumentError(f"there is no target {name!r}; {did_you_mean(str(name), TARGETS, known)}", "to")
    return TARGETS[name]


def checked_target(name: str, path: Path) -> Target:
    """The target of that name, whose files end as `path` does.

    Raises:
        ArgumentError: there is none, or it has another ending.
    """
    target = target_named(name)
    if path.suffix.lower() != target.suffix:
        raise ArgumentError(
            f"the file {path} does not end in {target.suffix}, which {target.called} expects; change that",
            "path",
        )
    return target


def _pairs(
    disparities: tuple[float, float] | Sequence[tuple[float, float]] | None, frames: int
) -> list[tuple[float, float]] | None:
    """A pair a frame."""
    if disparities is None:
        return None
    given = np.asarray(disparities, dtype=float)
    if given.shape not in ((2,), (frames, 2)) or not (np.isfinite(given).all() and (given >= 0).all()):
        raise ArgumentError(
            f"disparities is {disparities}; expected the least and the largest in 1/m, at least 0, of all"
            " frames or of each",
            "disparities",
        )
    return [(float(low), float(high)) for low, high in np.broadcast_to(given, (frames, 2))]
