"""Disparity in 1/m from stored depth, by a unit that is declared or read from the file, and never guessed.

    m, mm      w = 1 / (s v), or 1 / (s v / 1000)
    1/m        w = s v
    px         w = (s v + o) / (f b)      disparity of a stereo pair with focal length f in the depth map's
                                          pixels, baseline b in metres and offset o between principal points
    relative   w = a + c v                with a and c from two anchors: places or values of known distance

for stored values v and a scale s. What is not finite, negative or marked as invalid is a hole; a depth of
infinity is a disparity of 0.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from focusjax.geometry import Camera
from focusjax.photo._depth_file import StoredDepth
from focusjax.photo._errors import PhotoError

UNITS = ("m", "mm", "1/m", "px", "relative")
_FARTHEST_LIKELY, _NEAREST_LIKELY = 200.0, 0.02
"""Metres: a photograph's median distance beyond these is more likely a wrong unit."""
_BACKGROUND = 1e-9
"""In 1/m; what is no nearer is a background: renderers write infinity, or 1e10 m."""
_BEHIND_INFINITY = 0.01
"""Share of a relative map behind infinity from which on its anchors are doubted."""
_NEAR_FOR_ANCHORS = 0.1
"""Metres; nearer than that, and than half of the nearest anchor, anchors are doubted."""
_LARGEST_DISPARITY = 1e4
"""In 1/m; nothing nearer than a tenth of a millimetre is photographed."""


@dataclass(frozen=True)
class DepthUnit:
    """How stored values become disparity.

    Attributes:
        unit: one of `UNITS`.
        scale: what a stored value of 1 is in that unit.
        invalid: the stored value that marks holes; None for none.
        focal_length_px: of the depth map's pixels, for px.
        baseline_m: for px.
        offset_px: for px, added to disparities.
        anchors: for relative, two of (value, metres) or (x, y, metres) in the photograph's pixels.
    """

    unit: str
    scale: float = 1.0
    invalid: float | None = 0.0
    focal_length_px: float | None = None
    baseline_m: float | None = None
    offset_px: float = 0.0
    anchors: tuple[Sequence[float], ...] = ()


def check_unit(unit: DepthUnit, source: str) -> None:
    """Raise a `PhotoError` where something is missing to make disparity of `source`."""
    if unit.unit not in UNITS:
        raise PhotoError(f"{source}: the depth unit is {unit.unit!r}; expected one of {', '.join(UNITS)}")
    if not (math.isfinite(unit.scale) and unit.scale > 0):
        raise PhotoError(f"{source}: the depth scale is {unit.scale}; expected a positive number")
    if unit.unit == "px":
        for name, value in (("focal length", unit.focal_length_px), ("baseline", unit.baseline_m)):
            if value is None or not 0 < value < math.inf:
                raise PhotoError(
                    f"{source}: disparity in pixels needs the {name} of the stereo pair, which is {value};"
                    " give depth_focal_px in the depth map's pixels and baseline_m in metres"
                )
    pair = ("depth_focal_px", unit.focal_length_px), ("baseline_m", unit.baseline_m)
    for name, value in (*pair, ("depth_offset_px", unit.offset_px or None)):
        if unit.unit != "px" and value is not None:
            raise PhotoError(
                f"{source}: {name} is of a stereo pair, whose depth unit is 'px', and the unit is"
                f" {unit.unit!r}; leave one out"
            )
    if unit.unit == "relative" and len(unit.anchors) != 2:
        raise PhotoError(
            f"{source}: relative depth needs two anchors, and has {len(unit.anchors)}; give as anchors two"
            " places [x, y, metres] or two values [value, metres] of known distance"
        )
    if unit.unit != "relative" and unit.anchors:
        raise PhotoError(
            f"{source}: anchors are for relative depth, and the unit is {unit.unit}; leave one out"
        )
    for anchor in unit.anchors:
        if len(anchor) not in (2, 3) or not all(math.isfinite(v) for v in anchor[:-1]) or not anchor[-1] > 0:
            raise PhotoError(
                f"{source}: the anchor {list(anchor)} is no place [x, y, metres] or value [value, metres];"
                " expected a positive distance at its end"
            )
    if len({len(anchor) for anchor in unit.anchors}) > 1:
        raise PhotoError(
            f"{source}: one anchor is a place [x, y, metres] and the other a value [value, metres]; give two"
            " of the same form"
        )
    if unit.anchors and unit.anchors[0][-1] == unit.anchors[1][-1]:
        raise PhotoError(
            f"{source}: both anchors are {unit.anchors[0][-1]:g} m away, which makes everything flat; choose"
            " anchors at two distances"
        )


def disparity_of(
    stored: StoredDepth, unit: DepthUnit, size: tuple[int, int]
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"], float]:
    """Disparity in 1/m (0 in holes), where it is known, and the step of disparity between stored values.

    Args:
        stored: the depth map, upright.
        unit: what its values mean.
        size: width and height of the photograph, whose pixels anchors are counted in.

    Raises:
        PhotoError: nothing valid, all infinitely far, anchors on holes or of equal values or distances.

    Warns:
        Distances that no photograph has: the unit or the anchors contradict the values.
    """
    check_unit(unit, stored.source)
    v = np.asarray(stored.values, dtype=np.float64)
    known = ~np.isnan(v)
    if unit.invalid is not None:
        known &= v != unit.invalid
    scaled = np.where(known, v, 1.0) * unit.scale
    step = stored.step * unit.scale
    if unit.unit in ("m", "mm"):
        per_metre = 1000.0 if unit.unit == "mm" else 1.0
        metres = scaled / per_metre
        known &= metres > 0
        disparity = 1.0 / np.where(known, metres, 1.0)
        step = step / per_metre * float(np.median(disparity[known]) ** 2) if known.any() else 0.0
    else:
        known &= np.isfinite(v)
        factor, offset = _affine(unit, np.where(known, scaled, np.nan), stored.source, size)
        disparity = offset + factor * np.where(known, scaled, 0.0)
        if unit.unit == "relative" and known.any():
            _warn_of_anchors(disparity[known], unit, stored.source)
        known &= disparity >= 0
        step = abs(factor) * step
    if not known.any():
        raise PhotoError(
            f"{stored.source}: no value of this depth map is valid; expected positive numbers, and"
            f" {unit.invalid} only where nothing is known"
        )
    nearest = float(disparity[known].max())
    if nearest <= _BACKGROUND:
        raise PhotoError(
            f"{stored.source}: everything in this depth map is infinitely far, which leaves nothing to"
            " refocus; give the depth of a picture with something nearer"
        )
    if not nearest <= _LARGEST_DISPARITY:
        raise PhotoError(
            f"{stored.source}: in {unit.unit} the nearest place is {1.0 / nearest:.3g} m away; expected at"
            f" least {1.0 / _LARGEST_DISPARITY:g} m, so check the depth unit and scale, and what marks holes"
        )
    _warn_of_unlikely(disparity[known], unit, stored.source)
    return np.where(known, disparity, 0.0), known, step


def _affine(
    unit: DepthUnit, scaled: Float[np.ndarray, "h w"], source: str, size: tuple[int, int]
) -> tuple[float, float]:
    """Factor and offset from values to disparity."""
    if unit.unit == "1/m":
        return 1.0, 0.0
    if unit.unit == "px":
        assert unit.focal_length_px is not None
        assert unit.baseline_m is not None
        product = unit.focal_length_px * unit.baseline_m
        return 1.0 / product, unit.offset_px / product
    (first, near), (second, far) = (_anchor(anchor, scaled, unit, source, size) for anchor in unit.anchors)
    if abs(first - second) <= 1e-9 * max(abs(first), abs(second), 1e-30):
        raise PhotoError(
            f"{source}: both anchors have the value {first / unit.scale:g}; choose places at two distances"
        )
    factor = (near - far) / (first - second)
    return factor, near - factor * first


def _anchor(
    anchor: Sequence[float],
    scaled: Float[np.ndarray, "h w"],
    unit: DepthUnit,
    source: str,
    size: tuple[int, int],
) -> tuple[float, float]:
    """Scaled value and disparity of an anchor; of a place the median of the pixels around it."""
    disparity = 0.0 if anchor[-1] == math.inf else 1.0 / anchor[-1]
    if len(anchor) == 2:
        return float(anchor[0]) * unit.scale, disparity
    x, y = anchor[0], anchor[1]
    if not (0 <= x < size[0] and 0 <= y < size[1]):
        raise PhotoError(
            f"{source}: the anchor [{x:g}, {y:g}] is outside the photograph of {size[0]} x {size[1]} pixels"
        )
    column, row = int(x * scaled.shape[1] / size[0]), int(y * scaled.shape[0] / size[1])
    around = scaled[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
    if np.isnan(around).all():
        raise PhotoError(f"{source}: the anchor [{x:g}, {y:g}] is in a hole of the depth map; move it")
    return float(np.nanmedian(around)), disparity


def _warn_of_unlikely(disparity: Float[np.ndarray, "n"], unit: DepthUnit, source: str) -> None:
    """Say so where a unit makes distances that no photograph has."""
    middle = float(np.median(disparity))
    distance = math.inf if middle == 0 else 1.0 / middle
    far_greys = unit.unit == "m" and distance > 20.0
    eight_bit = unit.scale == 1.0 and (
        (far_greys and disparity.min() >= 1 / 255.5)
        or (unit.unit == "mm" and disparity.min() >= 1000 / 255.5)
    )
    if unit.unit in ("m", "mm", "1/m", "px") and (
        eight_bit or not _NEAREST_LIKELY <= distance <= _FARTHEST_LIKELY
    ):
        side = "farther" if distance > 1.0 else "nearer"
        greys = f"values of 0 to 255 look like 8-bit greys, not {'metres' if far_greys else 'millimetres'}; "
        values = greys if eight_bit else ""
        warnings.warn(
            f"{source}: in {unit.unit} half of the photograph is {side} than {distance:.3g} m, which is"
            f" unlikely; {values}check the depth unit and scale",
            stacklevel=1,
        )


def _warn_of_anchors(disparity: Float[np.ndarray, "n"], unit: DepthUnit, source: str) -> None:
    """Say so where anchors put much of a map behind infinity (below 0), or right before the lens."""
    behind = float((disparity < 0).mean())
    nearest = 1.0 / max(float(np.percentile(disparity, 99)), 1e-12)
    if behind > _BEHIND_INFINITY:
        found = f"{100 * behind:.0f} % of the depth map falls behind infinity and counts as holes"
    elif nearest < _NEAR_FOR_ANCHORS and nearest < 0.5 * min(anchor[-1] for anchor in unit.anchors):
        found = f"the nearest places are {100 * nearest:.2g} cm away"
    else:
        return
    warnings.warn(
        f"{source}: with these anchors {found}; check their distances, and choose one near and one far",
        stacklevel=1,
    )


def along_axis(disparity: Float[np.ndarray, "h w"], camera: Camera) -> Float[np.ndarray, "h w"]:
    """Disparity along the view axis from that along each pixel's ray.

    A point at distance d on the ray through (x, y), from the principal point and in focal lengths, is

        z = d / sqrt(1 + x^2 + y^2)

    ahead.

    Args:
        disparity: 1 / d of a map over the whole picture, of any size.
        camera: that took the photograph.
    """
    height, width = disparity.shape
    middle, focal = np.asarray(camera.principal_point, dtype=float), float(camera.focal_px)
    x = ((np.arange(width) + 0.5) * camera.width / width - middle[0]) / focal
    y = ((np.arange(height) + 0.5) * camera.height / height - middle[1]) / focal
    return disparity * np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)
