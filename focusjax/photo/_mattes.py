"""Pixels at silhouettes: how much of each is the foreground, and both colours.

A pixel at an edge holds a mixture I = a F + (1 - a) B of foreground F and background B. F is the mean of what
surely is foreground nearby, B the membrane of what surely is background. Both have a texture of variance s^2,
so the place of I between the two says as much about a as they differ by more than that, and the depth says
the rest: a is a_0 +- t with a_0 = 0.85 on the near and 0.15 on the far side of a tear. The likeliest share is

    a = ((I - B) . (F - B) / s^2 + a_0 / t^2) / (|F - B|^2 / s^2 + 1 / t^2),    cut to 0 to 1.

Where F and B are too alike for mixtures to show, a is 1 or 0: whichever of the two normal distributions with
the means and variances above is likelier to make I, at prior odds of a_0 to 1 - a_0. So the edge stays
where the depth has it, except for pixels that plainly are not what the depth says, such as a highlight on a
spoke that the depth map missed. What is left over of I is given to F and B by a s_F^2 and (1 - a) s_B^2, as
the likeliest colours have it, so that the sharp view is the photograph again (Porter and Duff 1984 for the
mixture; Hasinoff, Kang and Szeliski 2006 for mattes along depth edges).
"""

from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Bool, Float

_FAR_SHARE, _SPREAD = 0.15, 0.6
"""The share that pixels on the far side of a tear are expected to have, and how far off it may be."""
_NOISE = 1e-4
"""Variance of light that no texture explains."""
_INFORMATIVE = 0.5
"""Weight of the colours against the expectation below which they show no mixture."""
_UNSURE = 1e-3
"""Weight of pixels of the band itself: as foreground where there are no others, as in a wire; of lamps."""
_RADIUS = 1.5
_LEAST = 1 / 255


@dataclass(frozen=True)
class Mattes:
    """Edges taken apart.

    Attributes:
        share: of the foreground [h, w]; 1 off the band.
        near: linear foreground [h, w, 3]; the photograph off the band.
        far: linear background [h, w, 3]; as given off the band.
    """

    share: Float[np.ndarray, "h w"]
    near: Float[np.ndarray, "h w 3"]
    far: Float[np.ndarray, "h w 3"]


def mattes(
    light: Float[np.ndarray, "h w 3"],
    far: Float[np.ndarray, "h w 3"],
    near_side: Bool[np.ndarray, "h w"],
    band: Bool[np.ndarray, "h w"],
    near_band: Bool[np.ndarray, "h w"],
) -> Mattes:
    """Share, foreground and background of every pixel of `band`.

    Args:
        light: the photograph, linear.
        far: the membrane behind the band, linear.
        near_side: pixels that show the near side of a tear close by, the band's own among them.
        band: pixels to take apart.
        near_band: those of them whose depth is the foreground's.
    """
    # A lamp seen through twigs is brighter than white in pixels of theirs, too: they count last.
    lamp = light.max(axis=2) > 1.0
    doubt = np.where(lamp, _UNSURE**2, _UNSURE)
    weight = np.where(near_side & ~band, 1.0, np.where(near_band, doubt, 0.0)).astype(light.dtype)
    front, front_variance, found = _around(light, weight, band)
    far_lamp = lamp & band & ~near_band
    ground = np.where(~near_side & ~band, 1.0, np.where(far_lamp, _UNSURE, 0.0)).astype(light.dtype)
    _, back_variance, ground_found = _around(light, ground, band)
    back_variance = np.where(ground_found, back_variance, front_variance)
    own, behind = light[band], far[band]
    between = front - behind
    length = (between**2).sum(axis=1)
    precision = 1.0 / (0.5 * (front_variance + back_variance) + _NOISE)
    expected = np.where(near_band[band], 1.0 - _FAR_SHARE, _FAR_SHARE)
    place = ((own - behind) * between).sum(axis=1)
    share = (place * precision + expected / _SPREAD**2) / (length * precision + 1.0 / _SPREAD**2)
    # How much the colours count for the share, against what is expected by depth alone.
    counted = length * precision / (length * precision + 1.0 / _SPREAD**2)
    odds = np.log(expected / (1.0 - expected))
    odds += _likelihood(own, front, front_variance) - _likelihood(own, behind, back_variance)
    share = np.where(counted > _INFORMATIVE, np.clip(share, 0.0, 1.0), odds > 0.0)
    share = np.where(found, share, near_band[band])
    front = np.where(found[:, None], front, own)
    share = np.round(share * 255.0) / 255.0
    left = own - share[:, None] * front - (1.0 - share[:, None]) * behind
    front_part = share * (front_variance + _NOISE)
    back_part = (1.0 - share) * (back_variance + _NOISE)
    spread = share * front_part + (1.0 - share) * back_part
    front = np.maximum(front + (front_part / spread)[:, None] * left, 0.0)
    behind = np.maximum(behind + (back_part / spread)[:, None] * left, 0.0)
    # Where one of them would be negative, the other has it all.
    a = share[:, None]
    front = np.where(behind > 0.0, front, own / np.maximum(a, _LEAST))
    behind = np.where(front > 0.0, behind, own / np.maximum(1.0 - a, _LEAST))
    shares = np.ones(light.shape[:2], dtype=np.float32)
    near, back = light.copy(), far.copy()
    shares[band], near[band], back[band] = share, front, behind
    return Mattes(shares, near, back)


def _likelihood(
    own: Float[np.ndarray, "n 3"], mean: Float[np.ndarray, "n 3"], variance: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Log-likelihood of light; its channels vary together, so that they count as one."""
    spread = variance + _NOISE
    return -0.5 * (((own - mean) ** 2).mean(axis=1) / spread + np.log(spread))


def _around(
    light: Float[np.ndarray, "h w 3"], weight: Float[np.ndarray, "h w"], band: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Weighted means and variances of light around the pixels of `band`, and where there is any weight."""

    def blurred(values: np.ndarray) -> np.ndarray:
        return scipy.ndimage.gaussian_filter(weight * values, _RADIUS, truncate=3.0)[band]

    total = blurred(np.ones_like(weight))
    scale = 1.0 / np.maximum(total, 1e-12)
    mean = np.stack([blurred(light[..., c]) * scale for c in range(3)], axis=-1)
    square = blurred((light**2).mean(axis=2)) * scale
    return mean, np.maximum(square - (mean**2).mean(axis=1), 0.0), total > 1e-9
