"""Rays told apart by how blurred what they meet is: before the focal zone, in it, and behind it, in octaves.

A class's rays are summed for themselves, as `focusjax.trace._reconstruct` asks for.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.trace._focal_zone import FocalZone

_LEAST = 2.0
"""Radius in pixels: what is less blurred is left as the rays have it."""
_OCTAVES = 5


class BlurClasses(eqx.Module):
    """Classes from near to far.

    Attributes:
        near: disparities [p, k], decreasing, beyond which a pixel's rays meet something of class 0, 1, ...,
            the first the most blurred.
        far: disparities [p, m], decreasing, beyond which it is something of class k + 1, k + 2, ...
        least: least blur of each class (static), as a radius in pixels; 0 in the focal zone.
    """

    near: Float[Array, "p k"]
    far: Float[Array, "p m"]
    least: tuple[float, ...] = eqx.field(static=True)

    def of(self, pixels: Int[Array, " b"], disparity: Float[Array, "b s"]) -> Int[Array, "b s"]:
        """The class of what rays of some pixels meet."""
        near, far = self.near[pixels], self.far[pixels]
        found = jnp.full(disparity.shape, near.shape[1], dtype=jnp.int32)
        for number in range(near.shape[1]):
            found -= (disparity > near[:, number, None]).astype(jnp.int32)
        for number in range(far.shape[1]):
            found += (disparity < far[:, number, None]).astype(jnp.int32)
        return found


def one_class(pixels: int, dtype: np.dtype) -> BlurClasses:
    """Nothing told apart."""
    none = jnp.zeros((pixels, 0), dtype=dtype)
    return BlurClasses(none, none, (0.0,))


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
    near_edges = [edge for edge in reversed(edges) if edge < near]
    far_edges = [edge for edge in edges if edge < far]
    none = one_class(len(zone.near), zone.near.dtype)
    return BlurClasses(
        near=jnp.stack([zone.reach(edge)[0] for edge in near_edges], axis=1) if near_edges else none.near,
        far=jnp.stack([zone.reach(edge)[1] for edge in far_edges], axis=1) if far_edges else none.far,
        least=(*near_edges, 0.0, *far_edges),
    )
