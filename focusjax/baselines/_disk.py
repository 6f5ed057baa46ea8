"""Circles of confusion drawn on pixels, and pictures spread over them."""

import math
from typing import cast

import numpy as np
import scipy
from jaxtyping import Float

from focusjax._parallel import CORES

_SUBPIXELS = 10


def disk(radius: float) -> Float[np.ndarray, "n n"]:
    """Shares of its light that a point in the middle pixel spreads over each pixel; they sum to 1.

    A pixel's share is the part of it that lies within `radius` (in pixels) of the middle. Only pixels whose
    centres are closer than sqrt(2) / 2 to the circle are divided, into 10 x 10 (2006 defocus filter,
    section 3.1.2, adaptive supersampling); the others are all in or all out.
    """
    reach = max(0, math.ceil(radius - 0.5))
    steps = np.arange(-reach, reach + 1)
    x, y = np.meshgrid(steps, steps)
    distance = np.hypot(x, y)
    share = (distance < radius).astype(float)
    edge = np.abs(distance - radius) < math.sqrt(0.5)
    fine = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
    inside = np.hypot(
        x[edge][:, None, None] + fine[None, :, None], y[edge][:, None, None] + fine[None, None, :]
    )
    share[edge] = (inside < radius).mean(axis=(1, 2))
    total = share.sum()
    # A circle that misses even the subpixels of the middle leaves the light where it is.
    return share / total if total > 0 else np.ones((1, 1))


class Spreader:
    """Pictures of one size spread over disks by products of their Fourier transforms.

    Args:
        size: rows, and pixels per row.
        reach: the largest radius in pixels.
    """

    def __init__(self, size: tuple[int, ...], reach: float):
        border = math.ceil(reach) + 1
        self._size = size
        rows, columns = (scipy.fft.next_fast_len(n + border, real=True) for n in size)
        assert rows is not None
        assert columns is not None
        self._shape = (rows, columns)

    def transform(self, planes: Float[np.ndarray, "c h w"]) -> np.ndarray:
        """Transforms of planes, zero beyond the picture."""
        return cast(np.ndarray, scipy.fft.rfft2(planes, s=self._shape, workers=CORES))

    def transformed_disk(self, radius: float) -> np.ndarray:
        """The transform of the disk of `radius` pixels around the origin."""
        kernel = disk(radius)
        reach = len(kernel) // 2
        plane = np.zeros(self._shape)
        plane[: len(kernel), : len(kernel)] = kernel
        plane = np.roll(plane, (-reach, -reach), axis=(0, 1))
        return cast(np.ndarray, scipy.fft.rfft2(plane, workers=CORES))

    def picture(self, transforms: np.ndarray) -> Float[np.ndarray, "c h w"]:
        """The planes of some transforms, cut to the picture."""
        height, width = self._size
        planes = cast(np.ndarray, scipy.fft.irfft2(transforms, s=self._shape, workers=CORES))
        return planes[:, :height, :width]


def extended(plane: np.ndarray, border: int) -> np.ndarray:
    """A plane [h, w, ...] with its edge repeated over `border` pixels all around."""
    rest = ((0, 0),) * (plane.ndim - 2)
    return np.pad(plane, ((border, border), (border, border), *rest), mode="edge")
