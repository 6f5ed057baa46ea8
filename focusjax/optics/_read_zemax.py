"""The text files of Zemax (`.zmx`): sequential lenses of spherical, conic and even aspheric surfaces."""

import math
from pathlib import Path

from focusjax.optics._prescription import Prescription
from focusjax.optics._rows import LensFileError, LensText, Row, from_rows

_UNITS = {"MM": 1.0, "CM": 10.0, "METER": 1000.0, "M": 1000.0, "IN": 25.4}
_TYPES = ("STANDARD", "EVENASPH")
_MODEL = "___BLANK"


def read_zemax(path: Path) -> Prescription:
    """The surfaces between the object and the image, with the stop that the file marks.

    Read are UNIT, MODE, FNUM, ENPD, NAME and, of surfaces, TYPE, STOP, CURV, CONI, PARM, DISZ, GLAS and DIAM.
    The stop is as wide as FNUM or ENPD say, or DIAM; if none says, as wide as the other surfaces let an axial
    beam be.

    Raises:
        LensFileError: a surface type, mode or unit that is not supported, a mirror, numbers that are none, an
            unknown glass without index, or a lens that cannot be.
    """
    text = LensText(path)
    rows: list[Row] = []
    unit, name, openings = 1.0, "", {}
    for number, line in enumerate(text.lines, start=1):
        words = line.split()
        if not words:
            continue
        key, rest = words[0], words[1:]
        if key == "SURF":
            rows.append(Row(line=number))
        elif key == "NAME":
            name = " ".join(rest)
        elif key == "MODE" and rest[:1] != ["SEQ"]:
            raise text.refuse(number, f"mode {' '.join(rest)} is not supported; expected SEQ")
        elif key == "UNIT":
            if not rest or rest[0] not in _UNITS:
                raise text.refuse(
                    number, f"unit {' '.join(rest[:1])!r} is not known; expected MM, CM, IN or METER"
                )
            unit = _UNITS[rest[0]]
        elif key in ("FNUM", "ENPD") and rest:
            openings[key] = text.opening(number, text.number(number, rest[0], key))
        elif rows:
            _surface_line(text, number, rows[-1], key, rest)
    if len(rows) < 3:
        raise LensFileError(f"{path}: has {len(rows)} surfaces; expected an object, a lens and an image")
    inner = rows[1:-1]
    for row in inner:
        if not math.isfinite(row.thickness):
            raise text.refuse(row.line, "the surface is infinitely far from the next; expected a lens")
        _to_millimetres(row, unit)
    if "FNUM" in openings or "ENPD" in openings:
        for row in inner:
            row.semi_diameter = None if row.is_stop else row.semi_diameter
    pupil = openings["ENPD"] * unit if "ENPD" in openings else None
    return from_rows(text, inner, name or path.stem, f_number=openings.get("FNUM"), pupil_diameter=pupil)


def _surface_line(text: LensText, number: int, row: Row, key: str, rest: list[str]) -> None:
    """One line of a surface's block."""

    def value(place: int = 0) -> float:
        if len(rest) <= place:
            raise text.refuse(number, f"{key} ends early; expected a number")
        return text.number(number, rest[place], key)

    if key == "TYPE":
        if rest[:1] and rest[0] not in _TYPES:
            raise text.refuse(
                number, f"surface type {rest[0]} is not supported; expected {' or '.join(_TYPES)}"
            )
    elif key == "STOP":
        row.is_stop = True
    elif key == "CURV":
        row.curvature = value()
    elif key == "CONI":
        row.conic = value()
    elif key == "PARM":
        place, coefficient = int(value()), value(1)
        if coefficient and not 1 <= place <= 8:
            raise text.refuse(number, f"parameter {place} of an asphere is not supported; expected 1 to 8")
        grown = list(row.coefficients) + [0.0] * (place - len(row.coefficients))
        if 1 <= place <= 8:
            grown[place - 1] = coefficient
        row.coefficients = tuple(grown)
    elif key == "DISZ":
        row.thickness = math.inf if rest[:1] == ["INFINITY"] else value()
    elif key == "DIAM":
        semi_diameter = value()
        if semi_diameter < 0:
            text.opening(number, semi_diameter)
        row.semi_diameter = semi_diameter or None
    elif key == "GLAS":
        if not rest:
            raise text.refuse(number, "GLAS ends early; expected a name")
        _glass_line(text, number, row, rest)


def _glass_line(text: LensText, number: int, row: Row, rest: list[str]) -> None:
    """`GLAS name code pickup n_d V_d ...`; the name ___BLANK is a model of n_d and V_d."""
    name, numbers = rest[0], rest[3:5]
    if name == "MIRROR":
        raise text.refuse(number, "mirrors are not supported; expected a lens of glass")
    stated = [text.number(number, word, "GLAS") for word in numbers]
    usable = len(stated) == 2 and stated[0] > 1.0 and stated[1] > 0.0
    if name == _MODEL:
        if not usable:
            raise text.refuse(number, "a model glass has no index and Abbe number")
        row.glass = text.index(number, *stated)
        return
    try:
        row.glass = text.glass(number, name)
    except LensFileError:
        if not usable:
            raise
        text.warn_of_stand_in(number, name, *stated)
        row.glass = text.index(number, *stated)


def _to_millimetres(row: Row, unit: float) -> None:
    row.curvature /= unit
    row.thickness *= unit
    row.semi_diameter = None if row.semi_diameter is None else row.semi_diameter * unit
    row.coefficients = tuple(
        value * unit ** (1 - 2 * power) for power, value in enumerate(row.coefficients, start=1)
    )
