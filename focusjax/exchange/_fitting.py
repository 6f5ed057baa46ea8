"""What a target can say of a camera, and the nearest thing that it can."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from focusjax._words import listed
from focusjax.exchange._blur_error import blur_error
from focusjax.exchange._opening import Opening
from focusjax.exchange._record import Frame, Record, lens_of
from focusjax.lens import PrescriptionLens
from focusjax.optics import pbrt_lens_text

_EXACT_PX = 1e-3
"""Pixels by which a frame may be off by rounding."""


class ExportError(ValueError):
    """A camera that a target cannot have; the message says what could be exported instead.

    Example:
        >>> camera = fj.look_at((0, 0, 1), (0, 0, 0), width=8, height=6, focal_length=0.05)
        >>> lens = fj.tilt_shift_lens(focus_distance=2, tilt=0.1, f_number=2, focal_length=0.05)
        >>> fj.export_camera(camera, lens, "camera.usda", to="usd")
        Traceback (most recent call last):
        focusjax.exchange._fitting.ExportError: ...
    """


@dataclasses.dataclass(frozen=True)
class Target:
    """A program or format to write cameras for.

    Attributes:
        name: as users give it.
        called: as a sentence calls it.
        suffix: how its files end.
        has: the features (keys of `features`) that it can say.
        write: from a record that needs no other features, and the path of its file, to all files written.
    """

    name: str
    called: str
    suffix: str
    has: frozenset[str]
    write: Callable[[Record, Path], tuple[Path, ...]]


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A record as a target can have it.

    Attributes:
        record: what is to be written.
        remarks: one sentence for each thing that is approximated.
        blur_error_px: by how much the diameters of blur spots differ at most; 0 without approximations.
    """

    record: Record
    remarks: tuple[str, ...]
    blur_error_px: float


def features(record: Record) -> dict[str, str]:
    """What a target has to be able to say for `record`, each with the words for this one's."""
    frames, found = record.frames, {}
    if record.glass is not None:
        found |= _glass_features(record, record.glass)
    if record.beyond:
        found["beyond"] = listed(record.beyond)
    if record.surface is not None:
        found["surface"] = "a focal surface"
    if any(frame.tilted for frame in frames):
        most = max(frames, key=lambda frame: math.hypot(frame.tilt, frame.swing))
        tilt, swing = math.degrees(most.tilt), math.degrees(most.swing)
        found["tilt"] = f"a lens turned against the sensor (tilt {tilt:.3g}, swing {swing:.3g} degrees)"
    if record.opening.other:
        found["other opening"] = record.opening.words
    elif not record.opening.is_disk:
        found["opening"] = f"an opening of {record.opening.words}"
    slides = [_slide_px(record, frame) for frame in frames]
    if any(max(abs(x), abs(y)) > _EXACT_PX for x, y in slides):
        most = max(frames, key=lambda frame: math.hypot(frame.shift, frame.rise))
        words = f"a shifted lens (shift {1000 * most.shift:.4g}, rise {1000 * most.rise:.4g} mm)"
        found["shift"] = words
        if any(abs(2 * v - round(2 * v)) > 2 * _EXACT_PX for slide in slides for v in slide):
            found["fine shift"] = words + " that is not a whole number of half pixels"
    return found


def _glass_features(record: Record, lens: PrescriptionLens) -> dict[str, str]:
    """What is special in a real lens."""
    name = f"a real lens ({lens.prescription.name})"
    found = {"glass": name}
    try:
        pbrt_lens_text(lens.prescription, float(lens.film_place))
    except ValueError as error:
        found["odd glass"] = f"{name}, as {str(error).split(';')[0]}"
    if any(max(map(abs, _slide_px(record, frame))) > _EXACT_PX for frame in record.frames):
        found["shifted glass"] = f"{name} that is shifted over the sensor"
    return found


def fitted_to(
    record: Record,
    target: Target,
    targets: Mapping[str, Target],
    *,
    approximate: bool,
    disparities: Sequence[tuple[float, float]] | None = None,
) -> Fitted:
    """The record as `target` can have it.

    Args:
        record: what is to be written.
        target: for what.
        targets: all there are, for what could be exported instead.
        approximate: whether it may differ.
        disparities: least and largest in 1/m of what each frame sees, by which approximations are judged;
            from infinity to half the focus distance where they are not known.

    Raises:
        ExportError: the target cannot have it, and may not approximate.
    """
    found = features(record)
    lacks = frozenset(found) - frozenset(target.has)
    if not lacks:
        return Fitted(record, (), 0.0)
    if not approximate:
        raise refusal(found, target, targets)
    plain, remarks = _plainer(record, lacks)
    worst = 0.0
    for number, (frame, camera, lens) in enumerate(
        zip(plain.frames, record.cameras, record.lenses, strict=True)
    ):
        # A real lens that stays one differs by its opening alone.
        lens = lens if plain.glass is None else lens_of(record.frames[number], record.opening)
        focus = frame.plane[2]
        seen = (0.0, 2.0 * max(focus, 0.0)) if disparities is None else disparities[number]
        worst = max(worst, blur_error(lens, lens_of(frame, plain.opening), camera, seen))
    return Fitted(plain, tuple(remarks), worst)


def refusal(found: Mapping[str, str], target: Target, targets: Mapping[str, Target]) -> ExportError:
    """What is said of the first of some `features` that a target lacks; of `targets`, those that have all."""
    words = next(words for key, words in found.items() if key not in target.has)
    able = [each.name for each in targets.values() if found.keys() <= set(each.has)]
    named = " or ".join([", ".join(able[:-1]), able[-1]] if len(able) > 1 else able)
    instead = f"export to {named}, which can, or " if able else ""
    return ExportError(
        f"{target.called} cannot express {words}; {instead}add --approximate (approximate=True) for the"
        " nearest camera that it can"
    )


def _plainer(record: Record, lacks: frozenset[str]) -> tuple[Record, list[str]]:
    """The nearest record without what is lacking, and what was done."""
    remarks: list[str] = []
    frames, opening = record.frames, record.opening
    changes: dict[str, object] = {}
    if lacks & {"glass", "odd glass", "shifted glass"}:
        remarks.append("an ideal lens of the same focus distance and f-number stands in for the real one")
        changes["glass"] = None
    if "beyond" in lacks:
        remarks.append(f"{listed(record.beyond)} are left out")
        changes["beyond"] = ()
    if "surface" in lacks or "tilt" in lacks:
        remarks.append("the lens stands upright and focuses on the mean of the nearest and farthest focus")
        frames = tuple(_upright(record, number) for number in range(len(frames)))
        changes["surface"] = None
    if "opening" in lacks or "other opening" in lacks:
        remarks.append(f"a disk whose light is spread as widely stands in for {opening.words}")
        frames = tuple(
            dataclasses.replace(frame, aperture_radius=frame.aperture_radius * opening.radius_share)
            for frame in frames
        )
        opening = Opening()
    if "shift" in lacks:
        off = max(math.hypot(*_slide_px(record, frame)) for frame in frames)
        remarks.append(f"the lens is not shifted, so that the frame is off by {off:.1f} px")
        frames = tuple(dataclasses.replace(frame, shift=0.0, rise=0.0) for frame in frames)
    elif "fine shift" in lacks:
        rounded = tuple(_to_half_pixels(record, frame) for frame in frames)
        off = max(
            math.hypot(*np.subtract(_slide_px(record, one), _slide_px(record, two)))
            for one, two in zip(frames, rounded, strict=True)
        )
        remarks.append(f"the shift is rounded to half pixels, so that the frame is off by {off:.2f} px")
        frames = rounded
    return dataclasses.replace(record, frames=frames, opening=opening, **changes), remarks


def _upright(record: Record, number: int) -> Frame:
    """A frame's camera with the one focus whose largest error of blur over the picture is least."""
    frame = record.frames[number]
    if record.surface is not None:
        focus = record.surface[0]
    else:
        camera = record.cameras[number]
        corners = [(x, y) for x in (0.0, camera.width) for y in (0.0, camera.height)]
        tangents = (np.array(corners) - np.asarray(camera.principal_point)) / float(camera.focal_px)
        focus = frame.plane[2] + tangents @ np.array([frame.plane[0], -frame.plane[1]])
    middle = max(0.0, (float(np.min(focus)) + float(np.max(focus))) / 2.0)
    return dataclasses.replace(frame, plane=(0.0, 0.0, middle))


def _slide_px(record: Record, frame: Frame) -> tuple[float, float]:
    """Shift and rise in pixels."""
    scale = record.width / frame.sensor_width
    return frame.shift * scale, frame.rise * scale


def _to_half_pixels(record: Record, frame: Frame) -> Frame:
    step = frame.sensor_width / record.width / 2.0
    return dataclasses.replace(
        frame, shift=round(frame.shift / step) * step, rise=round(frame.rise / step) * step
    )
