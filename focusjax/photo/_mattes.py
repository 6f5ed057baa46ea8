"""Pixels at silhouettes: how much of each is the foreground, and both colours.

A pixel at an edge holds a mixture I = a F + (1 - a) B of foreground F and background B. F is the mean of what
surely is foreground nearby, B the membrane of what surely is background. The share a is the place of I
between the two,

    a = (I - B) . (F - B) / |F - B|^2,    cut to 0 to 1,

and what is left over of I is given to F and B by their shares, so that the sharp view is the photograph
again. Where both look alike, the edge stays where the depth has it (Porter and Duff 1984 for the mixture;
Hasinoff, Kang and Szeliski 2006 for mattes along depth edges).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter

_ALIKE = 0.02
"""Distance of two colours, encoded as for a display, below which no share can be told."""
_UNSURE = 1e-3
"""Weight of pixels of the band itself as foreground: only where there are no others, as in a wire."""
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
    weight = np.where(near_side & ~band, 1.0, np.where(near_band, _UNSURE, 0.0)).astype(light.dtype)
    total = gaussian_filter(weight, _RADIUS, truncate=3.0)
    front = np.stack(
        [gaussian_filter(weight * light[..., c], _RADIUS, truncate=3.0) for c in range(3)], axis=-1
    )
    own, behind = light[band], far[band]
    front = front[band] / np.maximum(total[band], 1e-12)[:, None]
    found = total[band] > 1e-9
    # Shares are of light, but whether colours differ is as the eye sees it.
    apart = np.linalg.norm(_shown(front) - _shown(behind), axis=1)
    between = front - behind
    length = np.maximum((between**2).sum(axis=1), 1e-12)
    share = np.clip(((own - behind) * between).sum(axis=1) / length, 0.0, 1.0)
    sure = np.clip(apart / _ALIKE - 1.0, 0.0, 1.0) * found
    share = sure * share + (1.0 - sure) * near_band[band]
    front = np.where(found[:, None], front, own)
    share = np.round(share * 255.0) / 255.0
    left = own - share[:, None] * front - (1.0 - share[:, None]) * behind
    spread = (share**2 + (1.0 - share) ** 2)[:, None]
    front = np.maximum(front + share[:, None] / spread * left, 0.0)
    behind = np.maximum(behind + (1.0 - share[:, None]) / spread * left, 0.0)
    # Where one of them would be negative, the other has it all.
    a = share[:, None]
    front = np.where(behind > 0.0, front, own / np.maximum(a, _LEAST))
    behind = np.where(front > 0.0, behind, own / np.maximum(1.0 - a, _LEAST))
    shares = np.ones(light.shape[:2], dtype=np.float32)
    near, back = light.copy(), far.copy()
    shares[band], near[band], back[band] = share, front, behind
    return Mattes(shares, near, back)


def _shown(light: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return np.maximum(light, 0.0) ** (1 / 2.2)
