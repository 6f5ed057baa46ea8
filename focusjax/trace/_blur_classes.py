"""Rays told apart by how blurred what they meet is: before the focal zone, in it, and behind it, in octaves.

A class's rays are summed for themselves, as `focusjax.trace._reconstruct` asks for.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.trace._focal_zone import FocalZone

_LEAST = 2.0
"""Radius in pixels: what is less blurred is left as the rays have it."""
_OCTAVES = 5


class BlurClasses(eqx.Module):
    """Classes from near to far.

    Attributes:
        zone: the focal zone of each pixel; not needed for one class only.
        near: least blur before the zone of class 0, 1, ... (static), as a radius in pixels, decreasing.
        far: the same behind it of classes after that of the zone (static), increasing.
    """

    zone: FocalZone | None
    near: tuple[float, ...] = eqx.field(static=True)
    far: tuple[float, ...] = eqx.field(static=True)

    @property
    def least(self) -> tuple[float, ...]:
        """Least blur of each class; 0 in the focal zone."""
        return (*self.near, 0.0, *self.far)

    def of(self, pixels: Int[Array, " b"], disparity: Float[Array, "b s"]) -> Int[Array, "b s"]:
        """The class of what rays of some pixels meet."""
        found = jnp.full(disparity.shape, len(self.near), dtype=jnp.int32)
        if self.zone is None:
            return found
        zone = jax.tree.map(lambda of_all: of_all[pixels], self.zone)
        for blur in self.near:
            found -= (disparity > zone.reach(blur)[0][:, None]).astype(jnp.int32)
        for blur in self.far:
            found += (disparity < zone.reach(blur)[1][:, None]).astype(jnp.int32)
        return found


ONE_CLASS = BlurClasses(None, (), ())
"""Nothing told apart."""


def blur_classes(zone: FocalZone, nearest: Float[Array, " p"], farthest: Float[Array, " p"]) -> BlurClasses:
    """The classes that a picture has; one where nothing in it is blurred.

    Args:
        zone: the lens's.
        nearest: largest disparity that the rays of each pixel can meet.
        farthest: least one; 0 where the background can be seen.
    """
    near, far = (
        float(jnp.max(zone.parallax * depth)) for depth in (nearest - zone.near, zone.far - farthest)
    )
    edges = [_LEAST * 2.0**k for k in range(_OCTAVES)]
    near_edges = tuple(edge for edge in reversed(edges) if edge < near)
    far_edges = tuple(edge for edge in edges if edge < far)
    return BlurClasses(zone, near_edges, far_edges) if near_edges or far_edges else ONE_CLASS
