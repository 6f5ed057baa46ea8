"""How the influence of a control point falls off with distance in the picture."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

SOFTENING_PX = 1e-4
"""Length in pixels added to every distance at right angles: weights stay finite at a control point.

There the point outweighs its neighbours so much that it is met all the same: its miss is the others'
difference times (SOFTENING_PX / distance)^exponent.
"""

_FLOOR = 1e-6
"""Share of the power law that local kernels keep, so that there is a smooth surface far from all points."""


class AbstractKernel(eqx.Module):
    """Influence as a function of distance, without bound at 0, so that surfaces meet their points."""

    @abc.abstractmethod
    def log_weight(self, squared_distance: Float[Array, "*k"]) -> Float[Array, "*k"]:
        """Natural logarithm of the weight at softened `squared_distance` in px^2, which is above 0.

        Logarithms, since the weights of one pixel span more than float32 holds.
        """


class InverseDistance(AbstractKernel):
    """1 / d^exponent, of Lee10 section 5.2: every point is felt everywhere, most of all close by.

    Attributes:
        exponent: 2 to 4 work well; larger ones flatten the surface around each point and make the
            passage between two of them steeper.
    """

    exponent: Float[Array, ""]

    def log_weight(self, squared_distance: Float[Array, "*k"]) -> Float[Array, "*k"]:
        return -0.5 * self.exponent * jnp.log(squared_distance)


class GaussianFade(AbstractKernel):
    """exp(-d^2 / (2 width^2)) / d^exponent: influence that ends softly a few widths away.

    Where all points are that far, the power law alone decides.

    Attributes:
        width: standard deviation in pixels.
        exponent: of the power law; above 0.
    """

    width: Float[Array, ""]
    exponent: Float[Array, ""]

    def log_weight(self, squared_distance: Float[Array, "*k"]) -> Float[Array, "*k"]:
        fade = jnp.exp(-0.5 * squared_distance / self.width**2)
        return _faded(fade, squared_distance, self.exponent)


class WendlandFade(AbstractKernel):
    """(1 - r)^4 (4 r + 1) / d^exponent with r = d / radius up to 1: influence that ends at a radius.

    The polynomial is twice differentiable (Wendland 1995). Where all points are farther away than their
    radius, the power law alone decides.

    Attributes:
        radius: in pixels, where the fade reaches 0.
        exponent: of the power law; above 0.
    """

    radius: Float[Array, ""]
    exponent: Float[Array, ""]

    def log_weight(self, squared_distance: Float[Array, "*k"]) -> Float[Array, "*k"]:
        r = jnp.sqrt(squared_distance) / self.radius
        fade = jnp.maximum(1.0 - r, 0.0) ** 4 * (4.0 * r + 1.0)
        return _faded(fade, squared_distance, self.exponent)


def _faded(
    fade: Float[Array, "*k"], squared_distance: Float[Array, "*k"], exponent: Float[Array, ""]
) -> Float[Array, "*k"]:
    """Logarithm of the power law times `fade`, which may be 0."""
    return jnp.log(_FLOOR + (1.0 - _FLOOR) * fade) - 0.5 * exponent * jnp.log(squared_distance)
