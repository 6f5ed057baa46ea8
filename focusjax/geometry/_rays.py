"""Lens rays as straight lines in (x, y, w), the one idea everything downstream rests on.

A ray that crosses the lens-centre plane z = 0 at (X0, Y0) with slopes m = (dX/dz, dY/dz) is at
X(z) = X0 + m z. Divide by z and scale by the focal length f in pixels: in image space at
disparity w it appears at

    q(w) = a + b w,        a = c + f (m_x, -m_y),        b = f (X0, -Y0),

with c the principal point and y turned downwards. That is exact for every straight ray, so a
lens is nothing but a source of (a, b) pairs and nothing after it needs to know which lens it was.
"""

import equinox as eqx
from jaxtyping import Array, Float


class LensRay(eqx.Module):
    """A ray leaving the lens, as the line q(w) = a + b w in image space.

    Attributes:
        a: image position in pixels where the ray goes at infinity (w = 0).
        b: pixels per dioptre; the crossing point of the lens plane times the focal length.
        weight: share of the light that travels along the ray, relative to an unobstructed one.
    """

    a: Float[Array, "*rays 2"]
    b: Float[Array, "*rays 2"]
    weight: Float[Array, "*rays"]

    def at(self, disparity: Float[Array, "*rays"]) -> Float[Array, "*rays 2"]:
        """Image position in pixels where the ray passes depth 1 / `disparity`."""
        return self.a + self.b * disparity[..., None]
