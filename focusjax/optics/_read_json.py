"""The JSON lens files of DeepLens: a list of surfaces with radii, materials and distances, in millimetres.

The same keys may be written as TOML, with a `[[surfaces]]` table for each surface.
"""

import json
import re
import tomllib
from typing import Any

from focusjax.optics._catalogue import UnknownGlassError
from focusjax.optics._glass import AbstractGlass
from focusjax.optics._lens_text import LensFileError, LensText
from focusjax.optics._prescription import Prescription
from focusjax.optics._rows import Row, from_rows

_STOPS = ("Stop", "Aperture")
_TYPES = ("Spheric", "Aspheric", *_STOPS)
_FACTORS = 16
"""The most that an asphere may have, of r^2 to r^32."""


def read_json(text: LensText) -> Prescription:
    """Surfaces of the types Spheric, Aspheric, Stop and Aperture.

    `r` is the semi-diameter, `roc` the radius; `c`, the curvature, is read where there is no `roc`. Aspheres
    have the conic constant `k` and the factors `ai` of r^2, r^4 and so on. Materials (`mat2`) are catalogue
    names, "n_d/V_d", or tables as `stated_glass` reads them; a stop without one is in the medium before it.
    What a Spheric says of an asphere is taken as such; a warning reports it.

    Raises:
        LensFileError: JSON that is malformed, keys that are missing, a surface type that is not supported, an
            unknown glass, or a lens that cannot be.
    """
    whole = "\n".join(text.lines)
    try:
        content = json.loads(whole)
    except json.JSONDecodeError as error:
        raise text.refuse(error.lineno, error.msg) from None
    except RecursionError:
        raise LensFileError(f"{text.path}: has lists within lists too deep to read") from None
    return _read(text, content, r'"type"\s*:')


def read_toml(text: LensText) -> Prescription:
    """As `read_json`, of the same keys in TOML.

    Raises:
        LensFileError: text that is no TOML, or as `read_json`.
    """
    try:
        content = tomllib.loads("\n".join(text.lines))
    except tomllib.TOMLDecodeError as error:
        raise LensFileError(f"{text.path}: this is not valid TOML ({error}); mend that line") from None
    except RecursionError:
        raise LensFileError(f"{text.path}: has lists within lists too deep to read") from None
    return _read(text, content, r"\btype\s*=")


def _read(text: LensText, content: Any, type_key: str) -> Prescription:
    """The lens of what a file has; `type_key` is found where a surface says its type."""
    whole = "\n".join(text.lines)
    if not isinstance(content, dict) or not isinstance(content.get("surfaces"), list):
        raise LensFileError(f'{text.path}: has no list "surfaces"')
    starts = [whole.count("\n", 0, found.start()) + 1 for found in re.finditer(type_key, whole)]
    rows = []
    for number, surface in enumerate(content["surfaces"]):
        # The line of the surface's type; of what lacks one, that of the list.
        line = starts[number] if number < len(starts) else 1
        rows.append(_row(text, line, f"surfaces[{number}]", surface, rows[-1].glass if rows else None))
    name = content.get("info")
    return from_rows(text, rows, name if isinstance(name, str) and name else text.path.stem)


def _row(text: LensText, line: int, called: str, surface: Any, before: AbstractGlass | None) -> Row:
    if not isinstance(surface, dict):
        raise text.refuse(line, f"a surface is {surface!r}; expected an object with a type")

    def value(key: str) -> float:
        if key not in surface:
            raise text.refuse(line, f'the surface has no "{key}"')
        return text.number(line, surface[key], key)

    kind = surface.get("type")
    if kind not in _TYPES:
        raise text.refuse(line, f"surface type {kind} is not supported; expected {', '.join(_TYPES)}")
    is_stop = kind in _STOPS
    curvature, conic, coefficients = 0.0, 0.0, ()
    if not is_stop:
        radius = value("roc") if "roc" in surface else None
        curvature = value("c") if radius is None else (1.0 / radius if radius else 0.0)
        conic = value("k") if "k" in surface else 0.0
        coefficients = _factors(text, line, surface.get("ai"))
    if kind == "Spheric" and (conic or coefficients):
        what = f"k = {conic:g}" if conic else "factors ai"
        text.warn(line, f"{called} is of the type Spheric, but has {what}; it is taken as that asphere")
    return Row(
        line=line,
        called=called,
        curvature=curvature,
        conic=conic,
        coefficients=coefficients,
        thickness=value("d_next"),
        semi_diameter=text.opening(line, value("r")),
        glass=_medium(text, line, surface, before if is_stop else None),
        is_stop=is_stop,
    )


def _factors(text: LensText, line: int, stated: Any) -> tuple[float, ...]:
    """The factors of r^2, r^4 and so on; none where they are all 0."""
    if stated is None:
        return ()
    if not isinstance(stated, list) or len(stated) > _FACTORS:
        raise text.refuse(line, f'"ai" is {stated!s:.60}; expected a list of at most {_FACTORS} numbers')
    factors = tuple(text.number(line, factor, "a factor in ai") for factor in stated)
    return factors if any(factors) else ()


def _medium(text: LensText, line: int, surface: dict, before: AbstractGlass | None) -> AbstractGlass:
    """What is after a surface; where nothing is said, `before`, if there is one."""
    name = surface.get("mat2")
    if name is None and before is not None:
        return before
    if isinstance(name, dict):
        return text.stated_glass(line, name)
    if not isinstance(name, str):
        said = "has no" if name is None else f"has {name!r} as its"
        raise text.refuse(line, f'the surface {said} "mat2"; expected a glass, "n_d/V_d", "air" or a table')
    try:
        return text.glass(line, name)
    except UnknownGlassError as error:
        raise text.refuse(line, error) from None
