"""Cameras for pbrt-v4: `perspective` with a lens radius, or `realistic` with the prescription of a real lens.

Camera space in pbrt is left-handed, with +z ahead, and a `Transform` holds the columns of the matrix
camera_from_world one after the other. `lensradius` and `focaldistance` are in scene units; `screenwindow` is
what the picture covers of the plane at which the shorter side's half of the field of view is 1 wide, so that
it can slide. A realistic camera stands on its film, counts its focus distance from there, and its film, whose
`diagonal` is in mm, keeps its size while the lens focuses. Source: pbrt-v4's file format and its source.
"""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from focusjax.exchange._files import distance, each_frame, number
from focusjax.exchange._record import Frame, Record
from focusjax.io import replace_file
from focusjax.lens import PrescriptionLens
from focusjax.optics import first_order, pbrt_lens_text

_AHEAD = np.diag([1.0, 1.0, -1.0, 1.0])


def write_pbrt(record: Record, path: Path) -> tuple[Path, ...]:
    """Write a file to be included before `WorldBegin`, with the lens file of a real lens beside it."""
    if record.glass is None:
        return each_frame(record, path, lambda one, file: replace_file(file, _perspective(one)))
    lens_file = path.with_suffix(".dat")
    camera, lens = _realistic(record, record.glass, lens_file.name)
    replace_file(lens_file, lens)
    replace_file(path, camera)
    return (path, lens_file)


def _perspective(record: Record) -> str:
    frame = record.frames[0]
    per_metre = record.width / frame.sensor_width
    # Screen space where the tangent of the shorter side's half angle is 1.
    shorter = min(record.width, record.height) / 2.0
    across, up = record.width / 2.0 / shorter, record.height / 2.0 / shorter
    right, above = frame.shift * per_metre / shorter, frame.rise * per_metre / shorter
    fov = math.degrees(2.0 * math.atan(shorter / per_metre / frame.focal_length))
    window = " ".join(number(v) for v in (right - across, right + across, above - up, above + up))
    lines = [
        *_placed(record, frame.pose),
        'Camera "perspective"',
        f'    "float fov" [ {number(fov)} ]',
        f'    "float screenwindow" [ {window} ]',
        f'    "float lensradius" [ {number(frame.aperture_radius)} ]',
        f'    "float focaldistance" [ {number(distance(frame.focus_distance))} ]',
        *_film(record),
    ]
    return "\n".join(lines) + "\n"


def _placed(record: Record, pose: Float[np.ndarray, "4 4"]) -> list[str]:
    """The comment and the matrix that a camera file begins with."""
    matrix = _AHEAD @ np.linalg.inv(pose)
    columns = " ".join(number(value + 0.0) for value in matrix.T.ravel())
    return [f"# Camera {record.name!r}, in metres, +y up", f"Transform [ {columns} ]"]


def _film(record: Record, diagonal: float | None = None) -> list[str]:
    lines = [
        'Film "rgb"',
        f'    "integer xresolution" [ {record.width} ]',
        f'    "integer yresolution" [ {record.height} ]',
    ]
    return lines if diagonal is None else [*lines, f'    "float diagonal" [ {number(diagonal)} ]']


def _realistic(record: Record, lens: PrescriptionLens, lens_name: str) -> tuple[str, str]:
    """The texts of the camera and of its lens file."""
    frame, glass = record.frames[0], lens.prescription
    film = float(lens.film_place)
    text = pbrt_lens_text(glass, film)
    length = float(np.sum(np.asarray(glass.thicknesses, dtype=float)[:-1]))
    # Another opening may stand in for the lens's own.
    open_to = frame.aperture_radius * 2.0 * float(lens.f_number(record.cameras[0])) / frame.focal_length
    # The camera stands in the entrance pupil, pbrt's on the film.
    behind = (length + film - float(lens.entrance_pupil)) / 1000.0
    pose = frame.pose.copy()
    pose[:3, 3] += behind * pose[:3, 2]
    lines = [
        *_placed(record, pose),
        'Camera "realistic"',
        f'    "string lensfile" [ "{lens_name}" ]',
        f'    "float focusdistance" [ {number(_focus_from_film(lens, length, film))} ]',
        f'    "float aperturediameter" [ {number(2.0 * float(glass.semi_diameters[glass.stop]) * open_to)} ]',
        *_film(record, _diagonal(record, frame, lens)),
    ]
    return "\n".join(lines) + "\n", text


def _diagonal(record: Record, frame: Frame, lens: PrescriptionLens) -> float:
    """Millimetres of the film's diagonal that frame the picture at this focus as focusjax does."""
    pixel = float(lens.film_scale) * frame.sensor_width / record.width / frame.focal_length
    return pixel * math.hypot(record.width, record.height)


def _focus_from_film(lens: PrescriptionLens, length: float, film: float) -> float:
    """Metres from the film to what is sharp by first-order optics when the film is where it is."""
    seen = first_order(lens.prescription)
    focal, image = float(seen.focal_length), film - float(seen.rear_principal_plane)
    front = length + film - float(seen.front_principal_plane)
    if image <= focal:
        return distance(math.inf)
    return distance((focal * image / (image - focal) + front) / 1000.0)
