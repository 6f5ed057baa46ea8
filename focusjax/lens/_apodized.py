"""Openings that let through more light in the middle than at the rim, or less (Lee10 section 5.3)."""

from collections.abc import Sequence
from typing import SupportsFloat

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax.lens._aperture import AbstractAperture, Disk, Polygon
from focusjax.lens._density import Density
from focusjax.lens._length import length
from focusjax.lens._obstructed import Obstructed
from focusjax.lens._spline import RadialSpline, radial_spline

_TURNS, _RADII = 120, 128
"""Steps around and along the radius of the table that rays are drawn by; most blades divide the former."""


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
