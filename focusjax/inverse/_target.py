"""The picture to fit, checked, and the weight of each of its values."""

import numpy as np
from jaxtyping import ArrayLike, Float

from focusjax.geometry import Camera

_MOST_LINEAR = 64.0
"""Whole numbers that go beyond it are codes of a screen or a file, not radiance."""
_NEAR_CODE = 1e-3
"""How near to a whole number a code of a file is, in single precision, too."""
_TO_LINEAR = (
    "; decode it to linear light first, for sRGB with v = picture / 255 by"
    " where(v > 0.04045, ((v + 0.055) / 1.055) ** 2.4, v / 12.92)"
)


def checked_target(target: ArrayLike, camera: Camera, mask: ArrayLike | None) -> Float[np.ndarray, "h w 3"]:
    """The picture, with 0 where it does not count.

    Raises:
        ValueError: not a linear picture of the camera's size, or not finite, the same everywhere or negative
            on the average where it counts. Display encoding is known by codes of 8 bits alone, as linear
            pictures may have 16.
    """
    picture = np.asarray(target)
    if picture.ndim != 3 or picture.shape[2] != 3:
        raise ValueError(f"the target has shape {picture.shape}; expected [height, width, 3], linear RGB")
    size, expected = picture.shape[1::-1], (camera.width, camera.height)
    if size != expected:
        odd = size[0] * expected[1] != size[1] * expected[0]
        shape = "; it is of another shape, too, so crop it before" if odd else ""
        raise ValueError(
            f"the target is {size[0]} x {size[1]} pixels but the layers are of {expected[0]} x {expected[1]};"
            f" resample it with skimage.transform.resize_local_mean(target, ({camera.height},"
            f" {camera.width}), channel_axis=-1), or peel for a camera of its size{shape}"
        )
    if picture.dtype.kind in "iub":
        raise ValueError(f"the target holds {picture.dtype} codes, in display encoding{_TO_LINEAR}")
    counts = checked_mask(mask, camera)
    broken = ~np.isfinite(picture).all(axis=-1) & counts
    if broken.any():
        row, column = np.argwhere(broken)[0]
        raise ValueError(
            f"the target is not finite in {int(broken.sum())} pixels, the first at x = {column}, y = {row};"
            " leave them out with mask"
        )
    picture = np.where(counts[..., None], picture, 0.0)
    if picture.max() > _MOST_LINEAR and (picture == np.round(picture)).all():
        raise ValueError(
            f"the target holds whole numbers up to {picture.max():g}, which suggests display codes from 0 to"
            f" 255{_TO_LINEAR}"
        )
    codes = 255.0 * picture
    coded = picture.max() <= 1.0 and (np.abs(codes - np.round(codes)) < _NEAR_CODE).all()
    if coded and len(np.unique(picture)) > 2:
        raise ValueError(
            f"the target holds multiples of 1/255 only, which suggests display codes over 255{_TO_LINEAR}"
        )
    if not (np.ptp(picture[counts], axis=0) > 0).any():
        raise ValueError("the target is the same everywhere, so that the lens cannot be estimated from it")
    if not picture[counts].mean() > 0:
        raise ValueError(
            f"the target's mean is {picture[counts].mean():.4g}; expected light, of positive radiance, from"
            " which no more than its black level was taken"
        )
    return picture


def checked_mask(mask: ArrayLike | None, camera: Camera) -> np.ndarray:
    """Which pixels [h, w] count.

    Raises:
        ValueError: of another size, or nothing counts.
    """
    if mask is None:
        return np.ones((camera.height, camera.width), dtype=bool)
    given = np.asarray(mask)
    if given.dtype.kind == "f" and not (np.isfinite(given) & ((given <= 0) | (given >= 1))).all():
        raise ValueError(
            "the mask holds values that are neither 0 nor 1 and more; a pixel counts or does not"
        )
    counts = given.astype(bool)
    if counts.shape != (camera.height, camera.width):
        raise ValueError(
            f"the mask has shape {counts.shape}; expected {(camera.height, camera.width)}, one value a pixel"
        )
    if not counts.any():
        raise ValueError("the mask is empty; at least one pixel has to count")
    return counts


def weights(
    counts: np.ndarray, noise: ArrayLike | None, shape: tuple[int, ...]
) -> Float[np.ndarray, "h w 3"]:
    """One over the variance of each value, 0 where it does not count.

    Raises:
        ValueError: noise that is not positive or of another shape.
    """
    spread = np.asarray(1.0 if noise is None else noise, dtype=np.float64)
    if spread.ndim == 2:
        spread = spread[..., None]
    try:
        spread = np.broadcast_to(spread, shape)
    except ValueError:
        raise ValueError(
            f"noise has shape {spread.shape}; expected one number, or one for each pixel or value of {shape}"
        ) from None
    counted = np.broadcast_to(counts[..., None], shape)
    if not ((spread[counted] > 0) & (spread[counted] < np.inf)).all():
        raise ValueError(
            "noise holds a standard deviation that is not positive and finite; leave such pixels out by mask"
        )
    return np.where(counted, 1.0 / np.where(counted, spread, 1.0) ** 2, 0.0)
