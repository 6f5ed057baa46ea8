"""Measured distortion, lateral colour and vignetting from a lensfun database that the user has."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any, SupportsFloat

import jax.numpy as jnp
import numpy as np

from focusjax._words import did_you_mean
from focusjax.lens._height_curve import HeightCurve, height_curve
from focusjax.lens._lensfun_entries import Measured, between, measured, number, vignetting_near
from focusjax.lens._profile import LensProfile
from focusjax.lens._profile_file import ProfileError

_FULL_DIAGONAL = math.hypot(36.0, 24.0) * 1e-3
_PLACES = 33
_Radial = Callable[[np.ndarray], np.ndarray]


def load_lensfun(
    path: str | Path,
    lens: str,
    *,
    focal_length: SupportsFloat,
    f_number: tuple[float, float] = (1.0, 64.0),
    aperture: SupportsFloat | None = None,
    focus_distance: SupportsFloat = math.inf,
) -> LensProfile:
    """The profile of a lens in a lensfun file: its distortion, lateral colour, and vignetting at an aperture.

    Radii are in halves of the short side of the sensor that was measured with, given by crop factor and
    aspect ratio, and models give the radius r_d on the film of what an ideal lens puts at r:

        poly3   r_d = r (1 - k1 + k1 r^2)
        poly5   r_d = r (1 + k1 r^2 + k2 r^4)
        ptlens  r_d = r (1 - a - b - c + c r + b r^2 + a r^3)

    The picture keeps its size on the axis, whatever the model does to it there. Lateral colour (linear,
    poly3) is that of red and blue against green. Of a zoom, coefficients between two focal lengths are in
    proportion. Vignetting (pa) is the share of light 1 + k1 r^2 + k2 r^4 + k3 r^6, with r in halves of the
    sensor's diagonal, unlike the others' (lensfun's manual, "Lens calibration data format",
    `lfDistortionModel`, `lfTCAModel`, `lfVignettingModel`; the two units in its mod-color.cpp). Between
    apertures and distances it is found as lensfun does, by their inverse distances.

    Args:
        path: an XML file; focusjax comes with none.
        lens: the model's name as the file has it, or part of it that no other has.
        focal_length: metres; within the range that was measured.
        f_number: range of the profile, which lensfun does not give.
        aperture: f-number whose vignetting it has; no vignetting if None, or where none was measured.
        focus_distance: metres, at which vignetting is wanted.

    Raises:
        ProfileError: a file that cannot be read, no such lens or several, one without distortion, an unknown
            model, an element that makes no sense, or a focal length or an aperture that was not measured.
    """
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise ProfileError(f"{path}: this lensfun file cannot be read ({error}); check the path") from None
    name, entry = _find(root, lens, path)
    focal = 1e3 * float(focal_length)
    try:
        unit, reach = _radii(entry)
        spread = between(list(measured(entry, "distortion")), focal)
        if spread is None:
            raise ValueError("has no measured distortion; choose another lens")
        radii = np.linspace(0.0, reach / unit, _PLACES)
        distortion = _distortion(_distorted(spread), radii, unit)
        fringes = between(list(measured(entry, "tca")), focal)
        lateral = None if fringes is None else _lateral(fringes, radii, unit)
        light = None
        if aperture is not None:
            light = _illumination(entry, focal, float(aperture), float(focus_distance), reach)
    except ValueError as error:
        raise ProfileError(f"{path}: {name}: {error}") from None
    known = {"distortion": distortion, "lateral_colour": lateral, "illumination": light}
    return LensProfile(
        title=name,
        focal_length=jnp.asarray(float(focal_length), dtype=float),
        f_number=f_number,
        focus_distance=(1e-3, math.inf),
        distortion=distortion,
        lateral_colour=lateral,
        illumination=light,
        sources=tuple((name, f"lensfun file {Path(path).name}") for name, held in known.items() if held),
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
    crop = number(entry.findtext("cropfactor") or "1", "cropfactor")
    ratio = (entry.findtext("aspect-ratio") or "1.5").split(":")
    aspect = number(ratio[0], "aspect-ratio") / (number(ratio[1], "aspect-ratio") if len(ratio) > 1 else 1.0)
    if not (crop > 0 and aspect >= 1):
        raise ValueError(
            f"has crop factor {crop:g} and aspect ratio {aspect:g}; expected above 0, and 1 or more"
        )
    corner = 0.5 * _FULL_DIAGONAL / crop
    return corner / math.hypot(1.0, aspect), corner


def _distorted(found: Measured) -> _Radial:
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


def _lateral(found: Measured, radii: np.ndarray, unit: float) -> tuple[HeightCurve, HeightCurve, HeightCurve]:
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


def _illumination(
    entry: Any, focal: float, f_number: float, distance: float, reach: float
) -> HeightCurve | None:
    """The share of light on the film by vignetting; None where none was measured."""
    if not (f_number > 0 and distance > 0):
        raise ValueError(
            f"is asked for at f/{f_number:g}, focused on {distance:g} m; expected numbers above 0"
        )
    terms = vignetting_near(
        list(measured(entry, "vignetting")), focal, f_number, distance, _zoom(entry, focal)
    )
    if terms is None:
        return None
    r = np.linspace(0.0, 1.0, _PLACES)
    shares = 1.0 + terms[0] * r**2 + terms[1] * r**4 + terms[2] * r**6
    if not shares.min() >= 0.0:
        raise ValueError(
            f"has vignetting near f/{f_number:g} that leaves {shares.min():.2g} of the light, below 0; its"
            f" k1, k2, k3 are {terms[0]:g}, {terms[1]:g}, {terms[2]:g}"
        )
    return height_curve(reach * r, shares)


def _zoom(entry: Any, focal: float) -> tuple[float, float]:
    """Shortest and longest focal length in mm; those of all that was measured if the file does not say."""
    stated = entry.find("focal")
    if stated is not None:
        ends = [stated.get(key, stated.get("value")) for key in ("min", "max")]
        if None not in ends:
            return number(ends[0], "focal min"), number(ends[1], "focal max")
    kinds = ("distortion", "tca", "vignetting")
    focals = [each.focal for kind in kinds for each in measured(entry, kind)] or [focal]
    return min(focals), max(focals)
