"""Multilayer: one sharp view cut into layers of like blur, each blurred, laid over one another."""

import math

import numpy as np
from jaxtyping import Float

from focusjax._checked_view import checked_view
from focusjax.baselines._disk import Spreader, extended
from focusjax.baselines._view import signed_radius
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens


def multilayer(
    image: Float[np.ndarray, "_ _ 3"],
    disparity: Float[np.ndarray, "_ _"],
    camera: Camera,
    lens: AbstractLens,
    *,
    layers: int = 16,
) -> Float[np.ndarray, "h w 3"]:
    """One sharp view as `layers` layers, blurred each for itself and composited from back to front.

    After Kraus and Strengert (2007). Layers lie evenly over the signed blur. What is nearer than a layer is
    cut out of it and filled in from around, coarse to fine (pull and push), for the lens sees past the
    edges of what is in front; so surfaces that cross layers stay closed, too. Every layer is spread over the
    disk of its blur with its opacity, and laid over those behind.

    The opening is taken for a disk. Beyond the frame the view goes on as at its edge.

    Args:
        image: linear radiance of the sharp view.
        disparity: 1/m at its pixel centres; 0 is infinitely far.
        camera: the frame.
        lens: its blur is used.
        layers: how many, at least 2.

    Raises:
        ValueError: sizes that differ from the camera's, values that are not finite, negative disparity, or
            fewer than two layers.

    Example:
        >>> from focusjax.baselines import multilayer
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> picture, disparity = np.full((6, 8, 3), 0.5), np.full((6, 8), 0.25)
        >>> multilayer(picture, disparity, camera, lens, layers=4).round(6)[3, 4].tolist()
        [0.5, 0.5, 0.5]
    """
    if layers < 2:
        raise ValueError(f"layers is {layers}; expected at least 2")
    picture, depth = checked_view(image, disparity, camera)
    radius = signed_radius(depth, camera, lens)
    farthest, nearest = float(radius.max()), float(radius.min())
    step = (nearest - farthest) / (layers - 1)
    border = math.ceil(float(np.abs(radius).max())) + 1
    # Which layer each pixel is in, 0 the farthest.
    place = extended(np.round((radius - farthest) / step) if step else np.zeros_like(radius), border)
    colour = extended(picture, border).transpose(2, 0, 1)
    spreader = Spreader(place.shape, border)
    out = np.zeros_like(colour)
    for number in range(layers):
        if not (place == number).any():
            continue
        # There is something behind everything.
        opacity = place == number if number else np.ones_like(place)
        planes = filled(np.concatenate([colour, opacity[None]]), place <= number)
        planes[:3] *= planes[3]
        blur = spreader.transformed_disk(abs(farthest + number * step))
        *light, covers = spreader.picture(spreader.transform(planes) * blur)
        out = np.stack(light) + (1.0 - covers) * out
    return out.transpose(1, 2, 0)[border:-border, border:-border]


def filled(planes: Float[np.ndarray, "c h w"], known: np.ndarray) -> Float[np.ndarray, "c h w"]:
    """`planes` with their values where `known` [h, w] and smooth ones elsewhere.

    Means of the known pixels over 2 x 2 blocks, again and again, until none is without; what is unknown then
    takes bilinear values of the next coarser level (Gortler et al. 1996). All zero if nothing is known.
    """
    if known.all() or not known.any():
        return np.where(known, planes, 0.0)
    height, width = known.shape
    even = (height + height % 2, width + width % 2)
    weights = np.zeros((1, *even))
    sums = np.zeros((len(planes), *even))
    weights[0, :height, :width] = known
    sums[:, :height, :width] = planes * known
    weight, total = _blocks(weights)[0], _blocks(sums)
    means = total / np.where(weight > 0, weight, 1.0)
    coarse = _doubled(filled(means, weight > 0))[:, :height, :width]
    return np.where(known, planes, coarse)


def _blocks(planes: np.ndarray) -> np.ndarray:
    """Sums over 2 x 2 blocks."""
    return planes[:, ::2, ::2] + planes[:, 1::2, ::2] + planes[:, ::2, 1::2] + planes[:, 1::2, 1::2]


def _doubled(planes: np.ndarray) -> np.ndarray:
    """Twice the size each way, bilinearly: centres of the fine pixels lie a quarter off the coarse ones."""
    for axis in (1, 2):
        width = [(0, 0)] * 3
        width[axis] = (1, 1)
        wide = np.pad(planes, width, mode="edge")
        count = planes.shape[axis]
        before, here, after = (wide.take(range(k, k + count), axis=axis) for k in range(3))
        pair = np.stack([0.25 * before + 0.75 * here, 0.75 * here + 0.25 * after], axis=axis + 1)
        planes = pair.reshape(*planes.shape[:axis], 2 * count, *planes.shape[axis + 1 :])
    return planes
