"""The text files of Zemax (`.zmx`): sequential lenses of spherical, conic and even aspheric surfaces."""

import dataclasses
import math

from focusjax.optics._catalogue import UnknownGlassError
from focusjax.optics._lens_text import LensFileError, LensText
from focusjax.optics._prescription import Prescription
from focusjax.optics._prescription import line as spectral_line
from focusjax.optics._rows import Row, from_rows

_UNITS = {"MM": 1.0, "CM": 10.0, "METER": 1000.0, "M": 1000.0, "IN": 25.4}
_TYPES = ("STANDARD", "EVENASPH")
_MODEL = "___BLANK"
_PLACEHOLDER = (1.5, 40.0)
"""The n_d and V_d that Zemax writes beside the name of a glass whose numbers are in a catalogue."""
_DISAGREE = 1e-3
"""Difference of n_d between file and catalogue above which there is a warning."""
_POWERS = 8
"""Of r^2 that the parameters of an even asphere are factors of."""


@dataclasses.dataclass
class _Block:
    """The lines of one surface.

    Attributes:
        row: what they say.
        kind: the surface's type.
        parameters: value and line of each, by its number.
    """

    row: Row
    kind: str = "STANDARD"
    parameters: dict[int, tuple[float, int]] = dataclasses.field(default_factory=dict)


def read_zemax(text: LensText) -> Prescription:
    """The surfaces between the object and the image, with the stop that the file marks.

    Read are UNIT, MODE, FNUM, ENPD, NAME and, of surfaces, TYPE, STOP, CURV, CONI, PARM, DISZ, GLAS and DIAM.
    The stop is as wide as FNUM or ENPD say, or DIAM; if none says, as wide as the other surfaces let an axial
    beam be. Surfaces of the type STANDARD are planes, spheres and conics, whatever PARM says of them; a
    warning reports what is not zero.

    Raises:
        LensFileError: a surface type, mode or unit that is not supported, a mirror, numbers that are none, an
            unknown glass without index or with Zemax's placeholder for it, or a lens that cannot be.
    """
    blocks: list[_Block] = []
    unit, name, openings = 1.0, "", {}
    for number, line in enumerate(text.lines, start=1):
        words = line.split()
        if not words:
            continue
        key, rest = words[0], words[1:]
        if key == "SURF":
            blocks.append(_Block(Row(line=number, called=f"SURF {rest[0] if rest else len(blocks)}")))
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
        elif blocks:
            _surface_line(text, number, blocks[-1], key, rest)
    if len(blocks) < 3:
        raise LensFileError(
            f"{text.path}: has {len(blocks)} surfaces; expected an object, a lens and an image"
        )
    for block in blocks[1:-1]:
        block.row.coefficients = _polynomial(text, block)
    inner = [block.row for block in blocks[1:-1]]
    for row in inner:
        if not math.isfinite(row.thickness):
            raise text.refuse(row.line, "the surface is infinitely far from the next; expected a lens")
        _to_millimetres(row, unit)
    if "FNUM" in openings or "ENPD" in openings:
        for row in inner:
            row.semi_diameter = None if row.is_stop else row.semi_diameter
    pupil = openings["ENPD"] * unit if "ENPD" in openings else None
    return from_rows(text, inner, name or text.path.stem, f_number=openings.get("FNUM"), pupil_diameter=pupil)


def _surface_line(text: LensText, number: int, block: _Block, key: str, rest: list[str]) -> None:
    """One line of a surface's block."""
    row = block.row

    def value(place: int = 0) -> float:
        if len(rest) <= place:
            raise text.refuse(number, f"{key} ends early; expected a number")
        return text.number(number, rest[place], key)

    if key == "TYPE":
        if not rest:
            raise text.refuse(number, f"TYPE ends early; expected {' or '.join(_TYPES)}")
        if rest[0] not in _TYPES:
            raise text.refuse(
                number, f"surface type {rest[0]} is not supported; expected {' or '.join(_TYPES)}"
            )
        block.kind = rest[0]
    elif key == "STOP":
        row.is_stop = True
    elif key == "CURV":
        row.curvature = value()
    elif key == "CONI":
        row.conic = value()
    elif key == "PARM":
        place = value()
        if not place.is_integer():
            raise text.refuse(number, f"the number of a parameter is {rest[0]}; expected a whole one")
        block.parameters[int(place)] = value(1), number
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


def _polynomial(text: LensText, block: _Block) -> tuple[float, ...]:
    """The factors of r^2, r^4 and so on that the parameters of an even asphere are.

    A standard surface has no parameters. Those in its block, left from another type, mean nothing to Zemax.
    """
    stated = {place: found for place, found in block.parameters.items() if found[0] != 0.0}
    if block.kind == "STANDARD":
        for place, (value, number) in stated.items():
            text.warn(
                number,
                f"parameter {place} of {block.row.called} is {value:g}, but surfaces of TYPE STANDARD have"
                " none; it is left out (an asphere is of TYPE EVENASPH)",
            )
        return ()
    for place, (_, number) in stated.items():
        if not 1 <= place <= _POWERS:
            raise text.refuse(
                number, f"parameter {place} of an asphere is not supported; expected 1 to {_POWERS}"
            )
    named = [place for place in block.parameters if 1 <= place <= _POWERS]
    return tuple(stated.get(place, (0.0,))[0] for place in range(1, max(named, default=0) + 1))


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
    placeholder = tuple(stated) == _PLACEHOLDER
    try:
        row.glass = text.glass(number, name)
    except UnknownGlassError as error:
        if placeholder:
            raise text.refuse(
                number,
                "n_d = 1.5 with V_d = 40 is what Zemax writes where a catalogue has the glass's numbers; give"
                " the AGF catalogue that has it (--glass FILE, glass in [lens] of a config), or write its n_d"
                f" and V_d there; {error}",
            ) from None
        if not usable:
            raise text.refuse(number, error) from None
        text.warn_of_stand_in(number, name, *stated)
        row.glass = text.index(number, *stated)
        return
    found = float(row.glass.index(spectral_line()))
    if usable and not placeholder and abs(found - stated[0]) > _DISAGREE:
        text.warn(
            number,
            f"glass {name} has n_d = {stated[0]:g} in the file and {found:.6g} in the"
            " catalogue, which is taken",
        )


def _to_millimetres(row: Row, unit: float) -> None:
    row.curvature /= unit
    row.thickness *= unit
    row.semi_diameter = None if row.semi_diameter is None else row.semi_diameter * unit
    row.coefficients = tuple(
        value * unit ** (1 - 2 * power) for power, value in enumerate(row.coefficients, start=1)
    )
