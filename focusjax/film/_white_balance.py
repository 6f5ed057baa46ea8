"""White balance: gains that make a light white."""

import math
from typing import SupportsFloat

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.film._photometry import LUMINANCE

_COLD = 6500.0
"""Kelvin of the light whose colours stay as they are."""

_LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)
"""Heights, places in nm and widths to either side of the lobes of the CIE 1931 colour matching functions
(Wyman, Sloan and Shirley 2013)."""

_RGB_FROM_XYZ = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
"""Linear sRGB (IEC 61966-2-1)."""


def grey_world_balance(image: Float[Array, "h w 3"]) -> Float[Array, "3"]:
    """Gains for red, green and blue that make the picture's mean grey, and leave its luminance as it is.

    A channel without any light has no such gain, and gives infinity.
    """
    mean = jnp.mean(image, axis=(0, 1))
    return (mean @ jnp.asarray(LUMINANCE, dtype=mean.dtype)) / mean


def balance_for(kelvin: SupportsFloat) -> Float[Array, "3"]:
    """Gains for red, green and blue that make the light of a black body look as one of 6500 K does.

    They leave the luminance of that light as it is. Colours follow Planck's law through the colour matching
    functions of Wyman, Sloan and Shirley (2013), and each channel of linear sRGB is scaled by itself.

    Args:
        kelvin: temperature of the light, 2000 to 25000: a candle 1900, a bulb 2700, the sun 5500, shade 8000.

    Raises:
        ValueError: another temperature.

    Example:
        >>> red, green, blue = balance_for(2700)
        >>> bool(red < green < blue)
        True
    """
    if not 2000.0 <= float(kelvin) <= 25000.0:
        raise ValueError(
            f"the light's temperature is {float(kelvin):g} K; expected from 2000 to 25000, such as 3200"
        )
    light = _black_body(float(kelvin)) / _black_body(_COLD)
    return jnp.asarray(np.dot(LUMINANCE, light) / light, dtype=float)


def _black_body(kelvin: float) -> np.ndarray:
    """Linear sRGB of a black body."""
    nm = np.arange(360.0, 831.0)
    radiance = nm**-5 / np.expm1(1.438777e7 / (nm * kelvin))
    xyz = [
        sum(
            height * np.exp(-0.5 * ((nm - place) / np.where(nm < place, left, right)) ** 2)
            for height, place, left, right in lobes
        )
        @ radiance
        for lobes in _LOBES
    ]
    return _RGB_FROM_XYZ @ np.array(xyz) / math.fsum(xyz)
