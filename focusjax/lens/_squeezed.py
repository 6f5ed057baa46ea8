"""An opening that looks narrower than it is high, as that of an anamorphic lens."""

from typing import SupportsFloat

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax._arguments import real_number
from focusjax.lens._aperture import AbstractAperture


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
