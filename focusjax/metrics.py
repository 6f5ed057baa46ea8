"""How near one linear picture is to another."""

from typing import cast

import numpy as np
from jaxtyping import ArrayLike, Bool


def psnr(
    image: ArrayLike,
    reference: ArrayLike,
    *,
    data_range: float = 1.0,
    mask: Bool[np.ndarray, "h w"] | None = None,
) -> float:
    """Peak signal-to-noise ratio in dB: 10 log10(R^2 / mean squared error) over pixels and channels.

    Args:
        image: linear radiance [h, w, 3].
        reference: linear radiance [h, w, 3].
        data_range: R, the radiance taken as the peak: 1 is display white, however bright the highlights.
        mask: the pixels [h, w] to compare; all when not given.

    Returns:
        Decibels, infinite for equal pictures.

    Raises:
        ValueError: shapes that differ or are not [h, w, 3], values that are not finite, a range that is
            not positive, a mask of another shape or without a pixel.

    Example:
        >>> round(psnr(np.full((4, 4, 3), 0.6), np.full((4, 4, 3), 0.5)), 6)
        20.0
    """
    first, second = _pair(image, reference, data_range)
    squared = (first - second) ** 2
    if mask is not None:
        if mask.shape != squared.shape[:2]:
            raise ValueError(f"the mask has shape {mask.shape}; expected the pictures' {squared.shape[:2]}")
        if not mask.any():
            raise ValueError("the mask selects no pixel; expected at least one")
        squared = squared[mask]
    error = float(squared.mean())
    return float("inf") if error == 0.0 else float(10.0 * np.log10(data_range**2 / error))


def ssim(image: ArrayLike, reference: ArrayLike, *, data_range: float = 1.0) -> float:
    """Mean structural similarity (Wang et al. 2004) with the paper's Gaussian window of sigma 1.5 pixels.

    Args:
        image: linear radiance [h, w, 3], at least 11 pixels each way.
        reference: linear radiance [h, w, 3].
        data_range: radiance taken as the peak, as for `psnr`.

    Returns:
        1 for equal pictures, less for others.

    Raises:
        ValueError: as for `psnr`, or pictures smaller than the window.
    """
    from skimage.metrics import structural_similarity

    first, second = _pair(image, reference, data_range)
    if min(first.shape[:2]) < 11:
        raise ValueError(f"the pictures have shape {first.shape}; the window needs 11 pixels each way")
    similarity = structural_similarity(
        first,
        second,
        data_range=data_range,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
    )
    return cast(float, similarity)


def _pair(image: ArrayLike, reference: ArrayLike, data_range: float) -> tuple[np.ndarray, np.ndarray]:
    first, second = (np.asarray(picture, dtype=np.float64) for picture in (image, reference))
    if first.shape != second.shape:
        raise ValueError(f"the pictures have shapes {first.shape} and {second.shape}; expected the same")
    if first.ndim != 3 or first.shape[-1] != 3 or first.size == 0:
        raise ValueError(f"the pictures have shape {first.shape}; expected height x width x 3")
    for name, picture in (("image", first), ("reference", second)):
        bad = int(np.count_nonzero(~np.isfinite(picture)))
        if bad:
            raise ValueError(f"the {name} has {bad} values that are not finite; expected linear radiance")
    if not data_range > 0:
        raise ValueError(f"the data range is {data_range}; expected a positive radiance such as 1")
    return first, second
