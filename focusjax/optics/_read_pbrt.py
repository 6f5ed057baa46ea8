"""The lens files of pbrt (`.dat`): four columns, from the scene's side to the film's, in millimetres."""

from focusjax.optics._lens_text import LensText
from focusjax.optics._prescription import Prescription
from focusjax.optics._rows import Row, from_rows

_COLUMNS = ("radius", "thickness", "index", "aperture diameter")


def read_pbrt(text: LensText) -> Prescription:
    """Radius, distance to the next surface, index after it, and diameter; radius and index 0 are the stop.

    A radius of 0 with an index is a plane. What follows `#` is a comment. Indices have no dispersion.

    Raises:
        LensFileError: a line that is not four numbers, or a lens that cannot be.
    """
    rows: list[Row] = []
    for number, line in enumerate(text.lines, start=1):
        words = line.partition("#")[0].split()
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
