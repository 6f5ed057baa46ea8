"""Entries of a lensfun lens: what was measured, and what lies between."""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

_POWER = 3.5
"""Of the distance between settings, by which lensfun weighs vignettings (Shepard's method)."""

_SAME = 1e-4
"""Distance between settings below which one is the other."""

_LARGEST = 1e6
"""Of all numbers, which are below ten but for distances in metres."""

_TOO_FAR = 1.0
"""Distance between settings from which on lensfun knows no vignetting."""


@dataclasses.dataclass(frozen=True)
class Measured:
    """One entry of a kind, at a focal length in mm, with the coefficients of its model and other numbers."""

    model: str
    focal: float
    terms: dict[str, float]
    element: str = ""


def measured(entry: Any, kind: str) -> Iterator[Measured]:
    """The entries of a kind that have a model.

    Raises:
        ValueError: an attribute that is no number; the element is named.
    """
    for calibration in entry.iter("calibration"):
        for each in calibration.iter(kind):
            element = f"<{kind} {' '.join(f'{key}={text!r}' for key, text in each.attrib.items())}>"
            terms = {
                key: number(text, f"{kind} {key}", element)
                for key, text in each.attrib.items()
                if key != "model"
            }
            focal, model = terms.pop("focal", 0.0), each.get("model", "none")
            if model != "none":
                yield Measured(model, focal, terms, element)


def between(found: list[Measured], focal: float) -> Measured | None:
    """What holds at a focal length in mm, in proportion between the two nearest; None of none."""
    found = sorted(found, key=lambda each: each.focal)
    if not found:
        return None
    require_range(found, focal)
    below = [each for each in found if each.focal <= focal] or found[:1]
    above = [each for each in found if each.focal >= focal] or found[-1:]
    one, other = below[-1], above[0]
    if one.model != other.model or one.focal == other.focal:
        return min(one, other, key=lambda each: abs(each.focal - focal))
    share = (focal - one.focal) / (other.focal - one.focal)
    names = {**one.terms, **other.terms}
    terms = {key: (1 - share) * one.terms.get(key, 0.0) + share * other.terms.get(key, 0.0) for key in names}
    return Measured(one.model, focal, terms)


def require_range(found: list[Measured], focal: float) -> None:
    """Refuse a focal length in mm that was not measured.

    Raises:
        ValueError: it is 2 % or more outside.
    """
    least, most = (pick(each.focal for each in found) for pick in (min, max))
    slack = 0.02 * focal
    if not least - slack <= focal <= most + slack:
        span = f"{least:g} mm" + (f" to {most:g} mm" if most > least else "")
        raise ValueError(f"was measured at {span}, and the camera's focal length is {focal:.4g} mm; use that")


def vignetting_near(
    found: list[Measured],
    focal: float,
    f_number: float,
    distance: float,
    zoom: tuple[float, float],
) -> tuple[float, float, float] | None:
    """k1, k2, k3 of vignetting at a setting, as lensfun finds them among those measured; None of none.

    Entries count by 1 / d^3.5, with d the distance in focal length (as a share of the zoom), in 4 / f-number
    and in 0.1 m / focus distance (`lfLens::InterpolateVignetting`, lensfun 0.3).

    Focal lengths are mm, `zoom` the shortest and the longest of the lens; `distance` is metres, or infinite.

    Raises:
        ValueError: an entry without aperture or distance, of another model than "pa", or none that is near.
    """
    if not found:
        return None
    require_range(found, focal)
    for each in found:
        if each.model != "pa":
            raise ValueError(f"has vignetting by the model {each.model!r}, in {each.element}; expected pa")
        if not min(each.terms.get(key, 0.0) for key in ("aperture", "distance")) > 0:
            raise ValueError(f"has {each.element}, without an aperture and a distance above 0; mend it")
    span = max(zoom[1] - zoom[0], 0.0)
    sums, total, nearest = [0.0, 0.0, 0.0], 0.0, math.inf
    for each in found:
        apart = math.hypot(
            (each.focal - focal) / span if span else 0.0,
            4.0 / each.terms["aperture"] - 4.0 / f_number,
            0.1 / each.terms["distance"] - 0.1 / distance,
        )
        terms = [each.terms.get(key, 0.0) for key in ("k1", "k2", "k3")]
        if apart < _SAME:
            return terms[0], terms[1], terms[2]
        nearest, weight = min(nearest, apart), apart**-_POWER
        sums, total = [s + weight * term for s, term in zip(sums, terms, strict=True)], total + weight
    if nearest > _TOO_FAR:
        raise ValueError(
            f"has no vignetting that was measured near f/{f_number:g} and {distance:g} m; choose others"
        )
    return sums[0] / total, sums[1] / total, sums[2] / total


def number(text: str, what: str, element: str = "") -> float:
    """A number that an ideal lens and a measured one may differ by, or be set to.

    Raises:
        ValueError: it is none, or beyond a million either way.
    """
    where = f", in {element}" if element else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{what} is {text!r}{where}; expected a number")
    if abs(value) > _LARGEST:
        raise ValueError(f"{what} is {text!r}{where}; expected a number from {-_LARGEST:g} to {_LARGEST:g}")
    return value
