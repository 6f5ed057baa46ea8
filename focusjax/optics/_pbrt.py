"""Lens files of pbrt (`.dat`), read and written: four columns, from the scene's side to the film's, in mm."""

import numpy as np

from focusjax.optics._lens_text import LensText
from focusjax.optics._prescription import Prescription, line
from focusjax.optics._rows import Row, from_rows
from focusjax.optics._surfaces import Conic

_COLUMNS = ("radius", "thickness", "index", "aperture diameter")


def read_pbrt(text: LensText) -> Prescription:
    """Radius, distance to the next surface, index after it, and diameter; radius and index 0 are the stop.

    A radius of 0 with an index is a plane. What follows `#` is a comment. Indices have no dispersion.

    Raises:
        LensFileError: a line that is not four numbers, or a lens that cannot be.
    """
    rows: list[Row] = []
    for number, row in enumerate(text.lines, start=1):
        words = row.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 4:
            raise text.refuse(number, f"has {len(words)} columns; expected {', '.join(_COLUMNS)}")
        radius, thickness, index, diameter = (
            text.number(number, word, what) for word, what in zip(words, _COLUMNS, strict=True)
        )
        is_stop = radius == 0 and index == 0
        glass = rows[-1].glass if is_stop and rows else None
        rows.append(
            Row(
                line=number,
                called=f"the surface of line {number}",
                curvature=1.0 / radius if radius else 0.0,
                thickness=thickness,
                semi_diameter=text.opening(number, diameter) / 2.0,
                glass=glass if is_stop else text.index(number, index, None),
                is_stop=is_stop,
            )
        )
    return from_rows(text, rows, text.path.stem)


def pbrt_lens_text(lens: Prescription, film: float) -> str:
    """The text of a lens file: radius, distance to the next surface, index after it, diameter; mm.

    Indices are those of the line d.

    Args:
        lens: of spherical surfaces.
        film: mm from the last vertex to the film.

    Raises:
        ValueError: a surface that is not spherical, a flat one, which pbrt takes for the stop, or a stop on
            glass.

    Example:
        >>> print(pbrt_lens_text(fj.lens_preset("cooke_triplet_50mm_f4"), 40.0).splitlines()[1])
        # radius thickness index diameter, in mm
    """
    indices = np.asarray(lens.indices(line()), dtype=float)
    gaps = [*np.asarray(lens.thicknesses, dtype=float)[:-1], film]
    rows = [f"# {' '.join(lens.name.split())}", "# radius thickness index diameter, in mm"]
    for number, surface in enumerate(lens.surfaces):
        diameter = 2.0 * float(lens.semi_diameters[number])
        if number == lens.stop:
            if indices[number] != 1.0 or indices[number + 1] != 1.0:
                raise ValueError(
                    f"the stop of {lens.name} is surface {number}, which is of glass, and pbrt has stops"
                    " in air alone; give a lens whose stop is in air"
                )
            rows.append(f"0 {float(gaps[number])!r} 0 {diameter!r}")
            continue
        if _flat(lens, number):
            raise ValueError(
                f"surface {number} of {lens.name} is flat, and pbrt takes flat surfaces for the stop; give a"
                " lens without flat glass"
            )
        radius = 1.0 / float(surface.osculating()[0])
        rows.append(f"{radius!r} {float(gaps[number])!r} {float(indices[number + 1])!r} {diameter!r}")
    return "\n".join(rows) + "\n"


def _flat(lens: Prescription, number: int) -> bool:
    """Whether a surface is flat.

    Raises:
        ValueError: it is no sphere either.
    """
    surface = lens.surfaces[number]
    if not isinstance(surface, Conic) or float(surface.conic) != 0.0:
        raise ValueError(
            f"surface {number} of {lens.name} is not spherical, and pbrt knows no other; give a lens of"
            " spheres"
        )
    return float(surface.curvature) == 0.0
