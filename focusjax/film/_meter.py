"""Metering: the radiance that is to become grey, from a picture and what of it counts."""

import dataclasses
from collections.abc import Sequence
from typing import Literal, SupportsFloat, TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax.film._photometry import brightness

_CENTRE = 0.75
"""Share of the weight that a centre-weighted meter gives to its disk."""

Pattern: TypeAlias = Literal["average", "centre"]
"""All of the picture alike; or three quarters for a disk in its middle, half as wide as the picture is high,
and a quarter for the rest."""


@dataclasses.dataclass(frozen=True)
class Zone:
    """A part of the picture, and how bright it is to be.

    Attributes:
        region: a mask [h, w], a box (left, top, width, height) in pixels, or "average" or "centre".
        stops: how far above grey its mean is to be exposed; below 0 darker.
        weight: how much an error of a stop counts, squared, against those of other zones.

    Example:
        >>> picture = jnp.full((4, 6, 3), 0.5)
        >>> box = fj.Zone((0, 0, 3, 4), stops=1.0)
        >>> round(float(fj.meter(picture, box)), 6)
        0.25
    """

    region: Pattern | ArrayLike | Sequence[int]
    stops: SupportsFloat = 0.0
    weight: SupportsFloat = 1.0


def meter(image: Float[Array, "h w 3"], *zones: Zone | Pattern) -> Float[Array, ""]:
    """The radiance that should be exposed as a grey, by weighted least squares of the zones' errors in stops.

    Zone i, of mean luminance L_i, is off by log2(L_i / g) - stops_i when the radiance g is exposed as a grey,
    so that the best g has

        log2 g = sum w_i (log2 L_i - stops_i) / sum w_i.

    Of "average" alone it is the mean of the picture, as of a world that is grey on the whole. Differentiable
    in the picture.

    Args:
        image: linear radiance.
        zones: at least one, or names of patterns; "average" when there are none.

    Raises:
        ValueError: a region outside the picture, without pixels or of another size, an unknown pattern, or a
            weight that is not positive.

    Example:
        >>> round(float(meter(jnp.full((4, 6, 3), 0.5), "centre")), 6)
        0.5
    """
    height, width = image.shape[:2]
    chosen = [each if isinstance(each, Zone) else Zone(each) for each in (zones or ("average",))]
    grey = brightness(image)
    logs, total = [], 0.0
    for zone in chosen:
        weight = float(zone.weight)
        if not 0.0 < weight < float("inf"):
            raise ValueError(f"a zone's weight is {weight:g}; expected a positive number")
        share = jnp.asarray(metering_weights(zone.region, width, height), dtype=grey.dtype)
        logs.append(weight * (jnp.log2(jnp.sum(share * grey)) - float(zone.stops)))
        total += weight
    return 2.0 ** (sum(logs[1:], logs[0]) / total)


def metering_weights(
    region: Pattern | ArrayLike | Sequence[int], width: int, height: int
) -> Float[np.ndarray, "h w"]:
    """How much each pixel counts; they sum to 1. See `Zone` and `Pattern`.

    Raises:
        ValueError: as `meter`.
    """
    if isinstance(region, str):
        if region not in ("average", "centre"):
            raise ValueError(f'the meter is {region!r}; expected "average", "centre", or a region')
        weights = np.full((height, width), 1.0 / (width * height))
        if region == "centre":
            y, x = np.mgrid[0.5:height, 0.5:width]
            disk = np.hypot(x - width / 2, y - height / 2) <= max(height / 4, 0.71)
            if not disk.all():
                weights = np.where(disk, _CENTRE / disk.sum(), (1.0 - _CENTRE) / (~disk).sum())
        return weights
    values = np.asarray(region)
    if values.shape == (4,):
        left, top, across, down = (int(value) for value in values)
        if not (0 <= left < left + across <= width and 0 <= top < top + down <= height):
            raise ValueError(
                f"the metered box {values.tolist()} (left, top, width, height) is not within the picture of"
                f" {width} x {height} pixels; move it, or make it smaller"
            )
        mask = np.zeros((height, width))
        mask[top : top + down, left : left + across] = 1.0
    elif values.shape == (height, width):
        mask = values.astype(float)
    else:
        raise ValueError(
            f"the metered region has shape {values.shape}; expected a mask of {(height, width)}, or 4"
            " numbers: left, top, width and height"
        )
    if not (np.isfinite(mask).all() and (mask >= 0).all() and mask.sum() > 0):
        raise ValueError("the metered mask has no pixel, or values below 0; mark what is to be metered")
    return mask / mask.sum()
