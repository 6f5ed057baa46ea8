"""Textures that are drawn: two colours and a pattern."""

import colorsys

import numpy as np
import scipy.ndimage
from jaxtyping import Float

TEXELS = 64
"""Along each side. All textures of a data set have as many, so that all pictures share compiled programs."""

Picture = Float[np.ndarray, "64 64 3"]


def colour(random: np.random.Generator) -> Float[np.ndarray, "3"]:
    """A linear albedo of any hue."""
    hue, saturation, value = random.uniform(size=3)
    return np.array(colorsys.hsv_to_rgb(hue, 0.15 + 0.7 * saturation, 0.05 + 0.85 * value**1.5))


def texture(kind: str, random: np.random.Generator) -> Picture:
    """A linear picture of the pattern `kind` that repeats at its borders."""
    one, other = colour(random), colour(random)
    share = _share(kind, random)[..., None]
    return (one + share * (other - one)).astype(np.float32)


def _share(kind: str, random: np.random.Generator) -> Float[np.ndarray, "64 64"]:
    """Of the second colour at every texel."""
    at = (np.arange(TEXELS) + 0.5) / TEXELS
    repeats = 2 ** int(random.integers(1, 4))
    if kind == "plain":
        return np.zeros((TEXELS, TEXELS))
    if kind == "checks":
        odd = np.floor(2 * repeats * at) % 2
        return np.abs(odd[:, None] - odd[None, :])
    if kind == "stripes":
        odd = np.floor(2 * repeats * at) % 2
        stripes = np.broadcast_to(odd, (TEXELS, TEXELS))
        return stripes if random.uniform() < 0.5 else stripes.T
    if kind == "spots":
        away = (repeats * at) % 1.0 - 0.5
        return (np.hypot(away[:, None], away[None, :]) < random.uniform(0.2, 0.4)).astype(float)
    # Noise of one scale; around the borders it goes on at the other side.
    noise = scipy.ndimage.gaussian_filter(
        random.normal(size=(TEXELS, TEXELS)), TEXELS / (8.0 * repeats), mode="wrap"
    )
    return np.clip(0.5 + noise / (3.0 * noise.std()), 0.0, 1.0)
