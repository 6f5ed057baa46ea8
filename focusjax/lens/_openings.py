"""Openings other than a disk or blades: covered in the middle, squeezed, with a density, of any shape."""

from collections.abc import Sequence
from typing import SupportsFloat

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._arguments import real_number, real_numbers
from focusjax.lens._aperture import AbstractAperture, Disk, Polygon
from focusjax.lens._density import Density
from focusjax.lens._length import length
from focusjax.lens._spline import RadialSpline, radial_spline

_TURNS, _RADII = 120, 128
"""Steps around and along the radius of the table that rays are drawn by; most blades divide the former."""


class Obstructed(AbstractAperture):
    """An opening with a hole in its light of the same shape: blurred lights are rings.

    A mirror lens's secondary mirror covers 0.3 to 0.5 of the diameter. The light that it takes is made up
    for: exposure is that of the f-number.

    Attributes:
        outline: a whole opening that is of one density.
        obstruction: size of the covered part, a share of the outline's, 0 to below 1.
    """

    outline: AbstractAperture
    obstruction: Float[Array, ""]

    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        return self.at(jnp.stack([sample[1], sample[0]]))

    def rim(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        return self.outline.rim(turn)

    def hole(self) -> Float[Array, ""]:
        return self.obstruction

    def holds(self, point: Float[Array, "2"]) -> Bool[Array, ""]:
        return self.outline.holds(point) & ~self.outline.holds(point / self.obstruction)

    def density(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return self.outline.density(point)

    def finest(self) -> Float[Array, ""]:
        return 0.5 * (1.0 - self.obstruction) * self.outline.finest()


def obstructed(obstruction: SupportsFloat, outline: AbstractAperture | None = None) -> Obstructed:
    """An `Obstructed` opening with checked values; around a disk when no outline is given.

    Raises:
        ValueError: an obstruction outside 0 to 1, or an outline that has a hole or a density already.
    """
    whole = Disk() if outline is None else outline
    expected = "a share of the diameter between 0 and 1"
    if not 0.0 < real_number(obstruction, "obstruction", expected) < 1.0:
        raise ValueError(f"obstruction is {obstruction}; expected {expected}")
    if not isinstance(whole, Disk | Polygon):
        raise ValueError(f"an obstruction stands in a {type(whole).__name__}; expected a disk or blades")
    return Obstructed(whole, jnp.asarray(float(obstruction), dtype=float))


class Squeezed(AbstractAperture):
    """Any opening, narrowed along x: blurred lights are tall ovals.

    The radius that goes with the f-number is half the opening's height.

    Attributes:
        whole: the opening before.
        squeeze: how many times narrower it gets, 1 or more.
    """

    whole: AbstractAperture
    squeeze: Float[Array, ""]

    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        return self._narrowed(self.whole.point(sample))

    def rim(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        return self._narrowed(self.whole.rim(turn))

    def hole(self) -> Float[Array, ""] | None:
        return self.whole.hole()

    def holds(self, point: Float[Array, "2"]) -> Bool[Array, ""]:
        return self.whole.holds(self._widened(point))

    def density(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return self.whole.density(self._widened(point))

    def finest(self) -> Float[Array, ""]:
        return self.whole.finest() / self.squeeze

    def _widened(self, point: Float[Array, "2"]) -> Float[Array, "2"]:
        return jnp.stack([point[0] * self.squeeze, point[1]])

    def _narrowed(self, point: Float[Array, "2"]) -> Float[Array, "2"]:
        return jnp.stack([point[0] / self.squeeze, point[1]])


def squeezed(squeeze: SupportsFloat, whole: AbstractAperture) -> Squeezed:
    """A `Squeezed` opening with a checked squeeze.

    Args:
        squeeze: 1.33, 1.5 and 2 are those of anamorphic lenses.
        whole: any opening.

    Raises:
        ValueError: a squeeze below 1.
    """
    if not 1.0 <= real_number(squeeze, "squeeze", "1 or more, such as 1.5") < float("inf"):
        raise ValueError(f"squeeze is {squeeze}; expected 1 or more, such as 1.5")
    return Squeezed(whole, jnp.asarray(float(squeeze), dtype=float))


class Apodized(AbstractAperture):
    """An opening through which light passes in proportion to a profile T(r) over the pupil's radius.

    T falls off towards the rim in an apodisation filter, which makes blurred lights soft; one that rises
    makes them rings. What it takes altogether is made up for. Rays are drawn with the density T / mean(T), to
    a few ten-thousandths, so that none is wasted and evenly bright scenes stay even.

    Attributes:
        outline: an opening of one density between its hole and its rim.
        transmission: T, in any unit; counted as 0 where it dips below 0.
    """

    outline: AbstractAperture
    transmission: RadialSpline

    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        root, turn = self._table().point(sample)
        return self.outline.at(jnp.stack([root**2, turn]))

    def rim(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        return self.outline.rim(turn)

    def hole(self) -> Float[Array, ""] | None:
        return self.outline.hole()

    def holds(self, point: Float[Array, "2"]) -> Bool[Array, ""]:
        return self.outline.holds(point)

    def density(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return self._passes(point) / self._table().mean()

    def finest(self) -> Float[Array, ""]:
        # Where it peaks most, most of the light keeps within half of the way between two of its values.
        return self.outline.finest() / (2 * (self.transmission.values.shape[0] - 1))

    def _passes(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return jnp.maximum(self.transmission(length(point)), 0.0)

    def _table(self) -> Density:
        """Light over (sqrt(s), t) for places (s, t), so that all is smooth about the middle."""
        roots, turns = jnp.linspace(0.0, 1.0, _RADII + 1), jnp.linspace(0.0, 1.0, _TURNS + 1)

        def light(turn: Float[Array, ""], root: Float[Array, ""]) -> Float[Array, ""]:
            return 2.0 * root * self._passes(self.outline.at(jnp.stack([root**2, turn])))

        return Density(jax.vmap(jax.vmap(light, in_axes=(None, 0)), in_axes=(0, None))(turns, roots))


def apodized(
    transmission: ArrayLike | Sequence[SupportsFloat], outline: AbstractAperture | None = None
) -> Apodized:
    """An `Apodized` opening with checked values; a disk when no outline is given.

    Args:
        transmission: light let through at evenly spaced radii, from the middle to the rim, in any unit;
            [1, 0] is the parabola 1 - r^2.
        outline: a disk, blades, or either with an obstruction.

    Raises:
        ValueError: values that are negative, all 0, fewer than two; or an outline that has a density already.
    """
    whole = Disk() if outline is None else outline
    profile = radial_spline(transmission)
    numbers = np.asarray(profile.values)
    if (numbers < 0).any() or not (numbers > 0).any():
        raise ValueError(f"transmission is {numbers.tolist()}; expected light, 0 or more, not all 0")
    if not isinstance(whole, Disk | Polygon | Obstructed):
        name = type(whole).__name__
        raise ValueError(f"a transmission is given to a {name}; expected a disk or blades, or one obstructed")
    return Apodized(whole, profile)


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
