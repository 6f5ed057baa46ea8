"""How far a picture is from the converged one, all over and near silhouettes."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Float

from focusjax.geometry import Camera
from focusjax.lens import ThinLens
from focusjax.metrics import psnr, ssim

_JUMP_PX = 1.0


@dataclasses.dataclass(frozen=True)
class Score:
    """Nearness of two linear pictures; radiance 1, display white, is the peak.

    Attributes:
        psnr: dB over all pixels.
        ssim: mean structural similarity; None for pictures below 11 pixels.
        silhouette_psnr: dB over the pixels near silhouettes; None where there are none.
    """

    psnr: float
    ssim: float | None
    silhouette_psnr: float | None


def score(
    image: Float[np.ndarray, "h w 3"], reference: Float[np.ndarray, "h w 3"], band: Bool[np.ndarray, "h w"]
) -> Score:
    """`image` against `reference`, with `band` the pixels near silhouettes."""
    return Score(
        psnr=psnr(image, reference),
        ssim=ssim(image, reference) if min(image.shape[:2]) >= 11 else None,
        silhouette_psnr=psnr(image, reference, mask=band) if band.any() else None,
    )


def near_silhouettes(
    disparity: Float[np.ndarray, "h w"], camera: Camera, lens: ThinLens
) -> Bool[np.ndarray, "h w"]:
    """The pixels that the blur of a jump in depth reaches.

    A jump is where the blur diameters of two neighbours differ by more than a pixel; it reaches as far as
    the larger of their blur radii, and a pixel for the filter.

    Args:
        disparity: 1/m at pixel centres.
        camera: the frame.
        lens: a thin lens, whose blur is the same all over the frame.
    """
    centre = camera.principal_point
    # Blur is linear in disparity: two of its values give all.
    none, unit = (float(lens.blur(camera, centre, jnp.asarray(w, centre.dtype))) for w in (0.0, 1.0))
    radius = (none + (unit - none) * disparity) / 2.0
    reach = np.zeros(radius.shape)
    for axis in (0, 1):
        here, there = (np.take(radius, np.arange(k, radius.shape[axis] - 1 + k), axis) for k in (0, 1))
        jump = np.abs(here - there) > _JUMP_PX / 2
        farther = np.where(jump, np.maximum(np.abs(here), np.abs(there)) + 1.0, 0.0)
        for k in (0, 1):
            part = [slice(None)] * 2
            part[axis] = slice(k, radius.shape[axis] - 1 + k)
            reach[tuple(part)] = np.maximum(reach[tuple(part)], farther)
    band = np.zeros(radius.shape, dtype=bool)
    whole = np.ceil(reach).astype(int)
    for pixels in np.unique(whole[whole > 0]):
        band |= scipy.ndimage.distance_transform_edt(whole != pixels) <= pixels
    return band
