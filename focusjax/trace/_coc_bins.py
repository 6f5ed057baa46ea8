"""Circle-of-confusion bins: rays sorted by how blurred what they meet is, before the focal zone or behind.

Edges are octaves of the blur's radius in pixels, the same for every lens, so that a lens that moves needs no
other program. Rays of each bin are summed for themselves, as `focusjax.trace._denoise` asks for.
"""

import functools

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.trace._focal_zone import FocalZone

LEAST_BLUR = 2.0
"""Radius in pixels: what is less blurred is left as its rays have it."""
_OCTAVES = 4


class CocBins(eqx.Module):
    """Bins from near to far: before the zone by decreasing blur, the zone, behind it by increasing blur.

    Attributes:
        zone: the focal zone of each pixel; None for one bin that holds all rays.
    """

    zone: FocalZone | None

    @property
    def least(self) -> tuple[float, ...]:
        """Least radius in pixels of the blur in each bin; 0 in the focal zone."""
        if self.zone is None:
            return (0.0,)
        edges = [LEAST_BLUR * 2.0**k for k in range(_OCTAVES)]
        return (*reversed(edges), 0.0, *edges)

    def of(self, pixel: Int[Array, " g"], disparity: Float[Array, "s g"]) -> Int[Array, "s g"]:
        """The bin of what some rays of each of some pixels meet."""
        if self.zone is None:
            return jnp.zeros(disparity.shape, dtype=jnp.int32)
        near, far, parallax = (
            plane.at[pixel].get(mode="clip")[None]
            for plane in (self.zone.near, self.zone.far, self.zone.parallax)
        )

        def octave(depth: Float[Array, "s g"]) -> Int[Array, "s g"]:
            """0 within the zone, 1 from the least blur on, one more for each time that it doubles."""
            blur = parallax * depth
            reached = [(blur >= LEAST_BLUR * 2.0**k).astype(jnp.int32) for k in range(_OCTAVES)]
            return functools.reduce(jnp.add, reached)

        return _OCTAVES - octave(disparity - near) + octave(far - disparity)
