"""The JSON lens files of DeepLens: a list of surfaces with radii, materials and distances, in millimetres."""

import json
import re
from pathlib import Path
from typing import Any

from focusjax.optics._prescription import Prescription
from focusjax.optics._rows import LensFileError, LensText, Row, from_rows

_TYPES = ("Spheric", "Stop", "Aperture")


def read_json(path: Path) -> Prescription:
    """Surfaces of the types Spheric, Stop and Aperture; `r` is the semi-diameter and `roc` the radius.

    `c`, the curvature, is read where there is no `roc`. Materials are catalogue names or "n_d/V_d".

    Raises:
        LensFileError: JSON that is malformed, keys that are missing, a surface type that is not supported, an
            unknown glass, or a lens that cannot be.
    """
    text = LensText(path)
    whole = "\n".join(text.lines)
    try:
        content = json.loads(whole)
    except json.JSONDecodeError as error:
        raise text.refuse(error.lineno, error.msg) from None
    except RecursionError:
        raise LensFileError(f"{path}: has lists within lists too deep to read") from None
    if not isinstance(content, dict) or not isinstance(content.get("surfaces"), list):
        raise LensFileError(f'{path}: has no list "surfaces"')
    starts = [whole.count("\n", 0, found.start()) + 1 for found in re.finditer(r'"type"\s*:', whole)]
    rows = []
    for number, surface in enumerate(content["surfaces"]):
        # The line of the surface's type; of what lacks one, that of the list.
        line = starts[number] if number < len(starts) else 1
        rows.append(_row(text, line, f"surfaces[{number}]", surface))
    name = content.get("info")
    return from_rows(text, rows, name if isinstance(name, str) and name else path.stem)


def _row(text: LensText, line: int, called: str, surface: Any) -> Row:
    if not isinstance(surface, dict):
        raise text.refuse(line, f"a surface is {surface!r}; expected an object with a type")

    def value(key: str) -> float:
        if key not in surface:
            raise text.refuse(line, f'the surface has no "{key}"')
        return text.number(line, surface[key], key)

    kind = surface.get("type")
    if kind not in _TYPES:
        raise text.refuse(line, f"surface type {kind} is not supported; expected {', '.join(_TYPES)}")
    is_stop = kind != "Spheric"
    curvature = 0.0
    if not is_stop:
        radius = value("roc") if "roc" in surface else None
        curvature = value("c") if radius is None else (1.0 / radius if radius else 0.0)
    return Row(
        line=line,
        called=called,
        curvature=curvature,
        thickness=value("d_next"),
        semi_diameter=text.opening(line, value("r")),
        glass=text.glass(line, str(surface.get("mat2", "air"))),
        is_stop=is_stop,
    )
