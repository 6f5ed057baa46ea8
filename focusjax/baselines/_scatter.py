"""Scatter: every pixel spreads its light over its circle of confusion."""

import math

import numpy as np
from jaxtyping import Float

from focusjax._checked_view import checked_view
from focusjax.baselines._disk import Spreader, extended
from focusjax.baselines._view import signed_radius
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens


def scatter(
    image: Float[np.ndarray, "_ _ 3"],
    disparity: Float[np.ndarray, "_ _"],
    camera: Camera,
    lens: AbstractLens,
    *,
    radius_step: float = 0.25,
    normalised: bool = False,
) -> Float[np.ndarray, "h w 3"]:
    """One sharp view, each pixel spread evenly over its circle of confusion, all added up.

    The linear filter of the 2006 defocus paper (section 3): disks with adaptively supersampled edges whose
    weights sum to one, so that no light is lost or made, on radiance without an upper limit, so that
    highlights keep their brightness when blurred. Pixels of like radius are spread together, by products of
    Fourier transforms: a pixel's light is shared between the disks of the two nearest radii. Nothing hides
    anything, so that where a blurred surface meets one in focus the sum is too bright on one side and too
    dark on the other; `normalised` divides it by the weight that arrived there.

    The opening is taken for a disk. Beyond the frame the view goes on as at its edge.

    Args:
        image: linear radiance of the sharp view.
        disparity: 1/m at its pixel centres; 0 is infinitely far.
        camera: the frame.
        lens: its blur is used.
        radius_step: pixels between the radii at which disks are drawn.
        normalised: divide by the weight that arrived, so that a uniform picture stays uniform over any depth;
            otherwise light is conserved.

    Raises:
        ValueError: sizes that differ from the camera's, values that are not finite, negative disparity, or a
            step that is not positive.

    Example:
        >>> from focusjax.baselines import scatter
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> picture, disparity = np.full((6, 8, 3), 0.5), np.full((6, 8), 0.25)
        >>> scatter(picture, disparity, camera, lens).round(6)[3, 4].tolist()
        [0.5, 0.5, 0.5]
    """
    if not 0 < radius_step < math.inf:
        raise ValueError(f"radius_step is {radius_step} pixels; expected a positive number such as 0.25")
    picture, depth = checked_view(image, disparity, camera)
    radius = np.abs(signed_radius(depth, camera, lens))
    reach = float(radius.max())
    border = math.ceil(reach) + 1
    weight = np.ones(depth.shape)
    planes = extended(np.concatenate([picture, weight[..., None]], axis=-1), border).transpose(2, 0, 1)
    level = extended(radius, border) / radius_step
    spreader = Spreader(level.shape, reach + radius_step)
    total: np.ndarray | float = 0.0
    channels = planes if normalised else planes[:3]
    lower = np.floor(level)
    for number in np.unique(np.concatenate([np.unique(lower), np.unique(np.ceil(level))])):
        share = np.maximum(0.0, 1.0 - np.abs(level - number))
        total = total + spreader.transform(channels * share) * spreader.transformed_disk(number * radius_step)
    spread = spreader.picture(np.asarray(total)).transpose(1, 2, 0)
    spread = spread[border:-border, border:-border]
    return spread[..., :3] / spread[..., 3:] if normalised else spread
