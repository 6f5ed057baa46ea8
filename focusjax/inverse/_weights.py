"""Weights of a picture's values from what a fit has left over."""

import numpy as np
from jaxtyping import Float

_HUBER = 1.345
"""Robust standard deviations beyond which residuals count linearly: 95 % efficient on normal ones."""
_WINDOW = 5
"""Edge in pixels of the square over which residuals are taken to be alike."""
_LEAST_SHARE = 0.05
"""Of the mean variance, which any is at least: plain parts are not known without limit."""
_LEAST_CONTRAST = 1e-4
"""Of the picture's contrast, likewise, for pictures without noise."""


def by_size(weight: Float[np.ndarray, "h w c"], residual: Float[np.ndarray, "h w c"]) -> np.ndarray:
    """Huber's weights, times those given."""
    size = np.sqrt(weight) * np.abs(residual)
    spread = 1.4826 * float(np.median(size[weight > 0]))
    factor = np.where(size > _HUBER * spread, _HUBER * spread / np.where(size > 0, size, 1.0), 1.0)
    return weight * factor


def by_spread(
    weight: Float[np.ndarray, "h w c"], residual: Float[np.ndarray, "h w c"], contrast: float
) -> np.ndarray:
    """The weights over the variance of the residuals around each pixel, in units of those given.

    Args:
        weight: of each value; 0 where it does not count.
        residual: picture less target.
        contrast: root of the sum of squares of the target about its mean, by weight.
    """
    from scipy.ndimage import uniform_filter

    counts = (weight > 0).mean(axis=2)
    squares = (weight * residual**2).mean(axis=2)
    near, known = (uniform_filter(a.astype(np.float64), _WINDOW, mode="constant") for a in (squares, counts))
    variance = np.maximum(near, 0.0) / np.maximum(known, 1e-12)
    total = float((weight > 0).sum())
    least = _LEAST_SHARE * float(squares.sum() / counts.sum()) + (_LEAST_CONTRAST * contrast) ** 2 / total
    return weight / (np.where(known > 0, variance, 0.0) + least)[..., None]
