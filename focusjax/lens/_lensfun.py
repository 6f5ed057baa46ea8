"""Measured distortion and lateral colour from a lensfun database that the user has."""

import dataclasses
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, SupportsFloat

import jax.numpy as jnp
import numpy as np

from focusjax._words import did_you_mean
from focusjax.lens._height_curve import HeightCurve, height_curve
from focusjax.lens._profile import LensProfile
from focusjax.lens._profile_file import ProfileError

_FULL_DIAGONAL = math.hypot(36.0, 24.0) * 1e-3
_PLACES = 33
_Radial = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class _Measured:
    """One entry of a kind, at a focal length in mm, with the coefficients of its model."""

    model: str
    focal: float
    terms: dict[str, float]


def load_lensfun(
    path: str | Path, lens: str, *, focal_length: SupportsFloat, f_number: tuple[float, float] = (1.0, 64.0)
) -> LensProfile:
    """The profile of a lens in a lensfun file: its distortion (poly3, poly5, ptlens) and lateral colour.

    Radii are in halves of the short side of the sensor that was measured with, given by crop factor and
    aspect ratio, and models give the radius r_d on the film of what an ideal lens puts at r:

        poly3   r_d = r (1 - k1 + k1 r^2)
        poly5   r_d = r (1 + k1 r^2 + k2 r^4)
        ptlens  r_d = r (1 - a - b - c + c r + b r^2 + a r^3)

    The picture keeps its size on the axis, whatever the model does to it there. Lateral colour (linear,
    poly3) is that of red and blue against green. Of a zoom, coefficients between two focal lengths are in
    proportion.

    Args:
        path: an XML file; focusjax comes with none.
        lens: the model's name as the file has it, or part of it that no other has.
        focal_length: metres; within the range that was measured.
        f_number: range of the profile, which lensfun does not tell.

    Raises:
        ProfileError: a file that cannot be read, no such lens or several, one without distortion, an unknown
            model, or a focal length that was not measured.
    """
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise ProfileError(f"{path}: this lensfun file cannot be read ({error}); check the path") from None
    name, entry = _find(root, lens, path)
    focal = 1e3 * float(focal_length)
    try:
        unit, reach = _radii(entry)
        spread = _between(list(_measured(entry, "distortion")), focal)
        if spread is None:
            raise ValueError("has no measured distortion; choose another lens")
        radii = np.linspace(0.0, reach / unit, _PLACES)
        distortion = _distortion(_distorted(spread), radii, unit)
        fringes = _between(list(_measured(entry, "tca")), focal)
        lateral = None if fringes is None else _lateral(fringes, radii, unit)
    except ValueError as error:
        raise ProfileError(f"{path}: {name}: {error}") from None
    tables = ["distortion"] + ([] if lateral is None else ["lateral_colour"])
    return LensProfile(
        title=name,
        focal_length=jnp.asarray(float(focal_length), dtype=float),
        f_number=f_number,
        focus_distance=(1e-3, math.inf),
        distortion=distortion,
        lateral_colour=lateral,
        sources=tuple((table, f"lensfun file {Path(path).name}") for table in tables),
    )


def _find(root: Any, wanted: str, path: str | Path) -> tuple[str, Any]:
    entries: dict[str, Any] = {}
    for entry in root.iter("lens"):
        # Names in other languages follow the first one.
        text = entry.findtext("model")
        if text:
            entries.setdefault(text.strip(), entry)
    if wanted in entries:
        return wanted, entries[wanted]
    near = [name for name in entries if wanted.casefold() in name.casefold()]
    if len(near) == 1:
        return near[0], entries[near[0]]
    if near:
        raise ProfileError(
            f"{path}: {len(near)} lenses are called {wanted!r}: {'; '.join(near[:5])}; name one"
        )
    some = "; ".join(list(entries)[:5])
    hint = did_you_mean(wanted, entries, f"it starts with {some}" if some else "it has none")
    raise ProfileError(f"{path}: has no lens {wanted!r}; {hint}")


def _radii(entry: Any) -> tuple[float, float]:
    """Metres of radius 1, and from the axis to the corner, on the sensor that was measured with."""
    crop = _number(entry.findtext("cropfactor") or "1", "cropfactor")
    ratio = (entry.findtext("aspect-ratio") or "1.5").split(":")
    aspect = _number(ratio[0], "aspect-ratio") / (
        _number(ratio[1], "aspect-ratio") if len(ratio) > 1 else 1.0
    )
    if not (crop > 0 and aspect >= 1):
        raise ValueError(
            f"has crop factor {crop:g} and aspect ratio {aspect:g}; expected above 0, and 1 or more"
        )
    corner = 0.5 * _FULL_DIAGONAL / crop
    return corner / math.hypot(1.0, aspect), corner


def _measured(entry: Any, kind: str) -> Iterator[_Measured]:
    for calibration in entry.iter("calibration"):
        for each in calibration.iter(kind):
            terms = {
                key: _number(text, f"{kind} {key}") for key, text in each.attrib.items() if key != "model"
            }
            focal = terms.pop("focal", 0.0)
            yield _Measured(each.get("model", "none"), focal, terms)


def _between(found: list[_Measured], focal: float) -> _Measured | None:
    """What holds at a focal length in mm, in proportion between the two nearest; None of none."""
    found = sorted((each for each in found if each.model != "none"), key=lambda each: each.focal)
    if not found:
        return None
    slack = 0.02 * focal
    if not found[0].focal - slack <= focal <= found[-1].focal + slack:
        span = f"{found[0].focal:g} mm" + (f" to {found[-1].focal:g} mm" if len(found) > 1 else "")
        raise ValueError(f"was measured at {span}, and the camera's focal length is {focal:.4g} mm; use that")
    below = [each for each in found if each.focal <= focal] or found[:1]
    above = [each for each in found if each.focal >= focal] or found[-1:]
    one, other = below[-1], above[0]
    if one.model != other.model or one.focal == other.focal:
        return min(one, other, key=lambda each: abs(each.focal - focal))
    share = (focal - one.focal) / (other.focal - one.focal)
    names = {**one.terms, **other.terms}
    terms = {key: (1 - share) * one.terms.get(key, 0.0) + share * other.terms.get(key, 0.0) for key in names}
    return _Measured(one.model, focal, terms)


def _distorted(found: _Measured) -> _Radial:
    """The radius on the film over that of the ideal lens."""
    k = found.terms.get
    if found.model == "poly3":
        return lambda r: 1.0 - k("k1", 0.0) + k("k1", 0.0) * r**2
    if found.model == "poly5":
        return lambda r: 1.0 + k("k1", 0.0) * r**2 + k("k2", 0.0) * r**4
    if found.model == "ptlens":
        a, b, c = k("a", 0.0), k("b", 0.0), k("c", 0.0)
        return lambda r: 1.0 - a - b - c + c * r + b * r**2 + a * r**3
    raise ValueError(f"has distortion by the model {found.model!r}; expected poly3, poly5 or ptlens")


def _distortion(ratio: _Radial, radii: np.ndarray, unit: float) -> HeightCurve:
    """Over the height on the film, which is what the model gives, not what it takes."""
    # As far as the corner of the photographs, which barrel distortion draws in.
    fine = np.linspace(0.0, 2.0 * radii[-1], 4096)
    landed = fine * ratio(fine) / ratio(np.zeros(()))
    folded = np.flatnonzero(np.diff(landed) <= 0)
    end = int(folded[0]) + 1 if len(folded) else len(fine)
    farthest = float(np.interp(radii[-1], landed[:end], fine[:end]))
    ideal = np.linspace(0.0, farthest, _PLACES)
    ratios = ratio(ideal) / ratio(np.zeros(()))
    heights = ideal * ratios
    if heights[-1] < radii[-1] * (1.0 - 1e-6):
        raise ValueError("has a distortion that folds the picture over before its corner; use another entry")
    return height_curve(unit * heights, ratios - 1.0)


def _lateral(
    found: _Measured, radii: np.ndarray, unit: float
) -> tuple[HeightCurve, HeightCurve, HeightCurve]:
    k = found.terms.get
    if found.model == "linear":
        ratios = [k("kr", 1.0) + 0.0 * radii, 1.0 + 0.0 * radii, k("kb", 1.0) + 0.0 * radii]
    elif found.model == "poly3":
        red, blue = (
            k(f"v{c}", 1.0) + k(f"c{c}", 0.0) * radii + k(f"b{c}", 0.0) * radii**2 for c in ("r", "b")
        )
        ratios = [red, 1.0 + 0.0 * radii, blue]
    else:
        raise ValueError(f"has lateral colour by the model {found.model!r}; expected linear or poly3")
    red, green, blue = (
        height_curve(unit * radii, unit * radii * (ratio - 1.0), even=False) for ratio in ratios
    )
    return red, green, blue


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{what} is {text!r}; expected a number")
    return value
