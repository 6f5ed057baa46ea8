"""An opening whose middle is covered, as that of a mirror lens."""

from typing import SupportsFloat

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax._arguments import real_number
from focusjax.lens._aperture import AbstractAperture, Disk, Polygon


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
