"""Cameras for Mitsuba 3: the sensor `thinlens`, or `perspective` for a pinhole, in XML or as a dict.

Its camera looks along its own +z axis, with +x to the left; its opening is a disk of `aperture_radius` in
scene units; it cannot slide a thin lens, but a crop of a wider film is the same where the axis meets a
pixel's middle or border. Source: Mitsuba's documentation of its sensors and films.
"""

import dataclasses
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.exchange._files import distance, each_frame, identifier, number
from focusjax.exchange._record import Frame, Record
from focusjax.io import replace_file

_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])


@dataclasses.dataclass(frozen=True)
class _Film:
    """The film of which the picture is a crop; its middle is on the view axis."""

    width: int
    height: int
    left: int
    top: int


def write_mitsuba(record: Record, path: Path) -> tuple[Path, ...]:
    """Write a scene that holds the sensor alone, one file for each frame of a shot."""
    return each_frame(record, path, lambda one, file: replace_file(file, mitsuba_xml(one)))


def mitsuba_xml(record: Record) -> str:
    """The text of a scene that holds the sensor of the record's first frame alone."""
    frame, film = record.frames[0], _film(record, record.frames[0])
    kind, floats = _sensor(record, frame, film)
    matrix = " ".join(number(value) for value in _pose(frame).ravel())
    lines = ['<scene version="3.0.0">', f'    <sensor type="{kind}" id="{identifier(record.name)}">']
    lines += [f'        <float name="{key}" value="{number(value)}"/>' for key, value in floats.items()]
    lines += [
        '        <string name="fov_axis" value="x"/>',
        '        <transform name="to_world">',
        f'            <matrix value="{matrix}"/>',
        "        </transform>",
        '        <film type="hdrfilm">',
    ]
    sizes = _film_sizes(record, film)
    lines += [f'            <integer name="{key}" value="{value}"/>' for key, value in sizes.items()]
    lines += ['            <rfilter type="box"/>', "        </film>", "    </sensor>", "</scene>", ""]
    return "\n".join(lines)


def mitsuba_dict(record: Record, mi: ModuleType) -> dict[str, Any]:
    """What `mitsuba.load_dict` takes for the sensor of the record's first frame.

    Args:
        record: what Mitsuba can have.
        mi: the module, set to a variant.
    """
    frame, film = record.frames[0], _film(record, record.frames[0])
    kind, floats = _sensor(record, frame, film)
    sizes = _film_sizes(record, film)
    return {
        "type": kind,
        **floats,
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f(_pose(frame)),
        "film": {"type": "hdrfilm", **sizes, "rfilter": {"type": "box"}},
    }


def _sensor(record: Record, frame: Frame, film: _Film) -> tuple[str, dict[str, float]]:
    """The kind of sensor, and its numbers."""
    pixel = frame.sensor_width / record.width
    floats = {
        "fov": math.degrees(2.0 * math.atan(film.width * pixel / 2.0 / frame.focal_length)),
        "near_clip": 0.001,
        "far_clip": 1e7,
    }
    if not frame.aperture_radius:
        return "perspective", floats
    lens = {"aperture_radius": frame.aperture_radius, "focus_distance": distance(frame.focus_distance)}
    return "thinlens", floats | lens


def _pose(frame: Frame) -> Float[np.ndarray, "4 4"]:
    return frame.pose @ _TURN + 0.0


def _film(record: Record, frame: Frame) -> _Film:
    per_metre = record.width / frame.sensor_width
    width, left = _side(record.width, -frame.shift * per_metre)
    height, top = _side(record.height, frame.rise * per_metre)
    return _Film(width, height, left, top)


def _side(pixels: int, off: float) -> tuple[int, int]:
    """Pixels of the whole film along one side, and where the picture starts there."""
    # The view axis meets the picture at `axis` half pixels from its start.
    axis = round(pixels + 2.0 * off)
    before = max(0, pixels - axis)
    return axis + 2 * before, before


def _film_sizes(record: Record, film: _Film) -> dict[str, int]:
    sizes = {"width": film.width, "height": film.height}
    if (film.width, film.height) == (record.width, record.height):
        return sizes
    crop = {"crop_offset_x": film.left, "crop_offset_y": film.top}
    return sizes | crop | {"crop_width": record.width, "crop_height": record.height}
