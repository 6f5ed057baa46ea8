"""One picture of a stack that is sharp wherever a shot is."""

from collections.abc import Sequence

import numpy as np
import scipy.ndimage
from jaxtyping import Float

_SEAM = 2.0
"""Standard deviation in pixels of how gradually one shot gives way to another."""


def merge(
    pictures: Sequence[Float[np.ndarray, "h w 3"]],
    blurs: Sequence[Float[np.ndarray, "h w"]],
    circle_px: float,
) -> Float[np.ndarray, "h w 3"]:
    """Each pixel from the shot with the least blur there, which is known, with smooth seams.

    Near a seam shots are mixed, but only such as blur the pixel by no more than the circle of confusion, or
    than the best one does. Beside a near thing that is out of focus in the shot of what is behind it, its
    blur stays.

    Args:
        pictures: linear, of one size.
        blurs: blur diameters in pixels of what each pixel shows first, of either sign.
        circle_px: blur in pixels that counts as sharp.

    Example:
        >>> one, two = np.zeros((1, 2, 3)), np.ones((1, 2, 3))
        >>> merge([one, two], [np.array([[0.0, 9.0]]), np.array([[9.0, 0.0]])], 1.0)[0, :, 0].tolist()
        [0.0, 1.0]
    """
    size = np.abs(np.stack([np.asarray(blur, dtype=float) for blur in blurs]))
    best = size.min(axis=0)
    first = np.argmin(size, axis=0)
    total, weights = np.zeros(size.shape[1:]), []
    for number in range(len(size)):
        own = (first == number).astype(float)
        share = scipy.ndimage.gaussian_filter(own, _SEAM, mode="nearest")
        weights.append(
            np.where(size[number] <= np.maximum(best, circle_px), np.maximum(share, 1e-6 * own), 0.0)
        )
        total += weights[-1]
    shares = np.stack(weights) / total
    return np.einsum("khw,khwc->hwc", shares, np.stack(pictures))
