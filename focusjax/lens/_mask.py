"""Openings of any shape, given by an image."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._arguments import real_numbers
from focusjax.lens._aperture import AbstractAperture, Disk
from focusjax.lens._density import Density


class Mask(AbstractAperture):
    """An opening that is an image: white lets light through, black does not.

    The image's middle is that of the lens, and its light just fits into the disk of the aperture radius.
    Between pixel centres light is bilinear, and rays are drawn with its density exactly. Lights behind the
    focus show the image upright, those in front of it upside down.

    A mask has no sharp rim: its outline is the disk around it, where no light passes, and its edges are
    slopes a pixel wide. Derivatives (those of `render`) hold for it as for other openings, the image's
    values included, but with more noise the finer the image is, as they come from rays through these slopes.

    Attributes:
        light: the image's light over its square, black on its border.
        half: half the sides of the image, in aperture radii.
    """

    light: Density
    half: Float[Array, "2"]

    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        return (2.0 * self.light.point(sample) - 1.0) * self.half

    def rim(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        return Disk().rim(turn)

    def hole(self) -> None:
        return None

    def holds(self, point: Float[Array, "2"]) -> Bool[Array, ""]:
        return (jnp.abs(point) < self.half).all()

    def density(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        within = (jnp.abs(point) < self.half).all()
        light = jnp.where(within, self.light.at(0.5 + 0.5 * point / self.half), 0.0)
        return light * jnp.pi / (self.light.mean() * 4.0 * jnp.prod(self.half))

    def finest(self) -> Float[Array, ""]:
        rows, columns = self.light.values.shape
        return (2.0 * self.half / jnp.array([columns - 1, rows - 1])).min()


def mask(image: ArrayLike | Sequence[Sequence[float]]) -> Mask:
    """A `Mask` from an image.

    Args:
        image: light let through [h, w], row 0 at the top, in any unit; white is what is brightest.

    Raises:
        ValueError: not an image, values that are negative or not finite, or no light at all.

    Example:
        >>> cross = mask([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
        >>> [round(float(v), 3) for v in cross.half]
        [0.894, 0.894]
    """
    values = real_numbers(image, "a mask of the opening", "numbers, a value for each of its pixels")
    if values.ndim != 2 or values.size == 0:
        raise ValueError(f"the aperture's image has shape {values.shape}; expected rows and columns of grey")
    if not np.isfinite(values).all() or values.min() < 0:
        raise ValueError("the aperture's image has values that are negative or not finite; expected light")
    if not values.max() > 0:
        raise ValueError("the aperture's image is black all over; leave something white")
    values = np.pad(values / values.max(), 1)
    rows, columns = values.shape
    # Light reaches from a white node to those around it.
    lit = np.zeros(values.shape, dtype=bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            lit |= np.roll(values > 0, (dy, dx), axis=(0, 1))
    y, x = np.nonzero(lit)
    reach = np.hypot(x - (columns - 1) / 2, y - (rows - 1) / 2).max()
    half = np.array([columns - 1, rows - 1]) / (2 * reach)
    return Mask(Density(jnp.asarray(values, dtype=float)), jnp.asarray(half, dtype=float))
