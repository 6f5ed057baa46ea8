"""Where the film of a real lens has to be for a plane in focus that leans, by first-order optics.

Axes are the lens's: Z ahead along its axis, 0 the entrance pupil's middle; w is in 1/mm. A level film is
sharp at the disparity w when its distance and scale are

    D(w) = (p/F - w)^-1 p^2 from the exit pupil,        s(w) = D(w) / p = -1 / S(w),        S(w) = w/p - 1/F,

p being the exit pupil's diameter over the entrance pupil's. Points of a plane m.P = 1 that are seen along
the tangents t have the disparity w(t) = m_z + m_xy . t, and their images, at the height -s(w(t)) t, are in a
plane again: the film. Its normal is along (m_xy, S(m_z)), so that a film whose normal is g has

    m_xy = S(m_z) g_xy / g_z,

and the plane meets the film's normal through the pupil at the disparity w_0 = g.m where

    m_z (g_z + |g_xy|^2 / (p g_z)) = w_0 + |g_xy|^2 / (F g_z).

For p = 1 this is Scheimpflug's rule of `_tilt_shift`.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.optics import Prescription, film_distance, first_order, line


class TiltedFilm(eqx.Module):
    """The film of a lens that may lean, by the disparity in 1/mm that it is sharp at from place to place.

    Attributes:
        top: of the fraction that is the distance in mm from the last vertex: [2], at w = 0 and per w.
        slope: S at w = 0 and per w, [2] in 1/mm and 1.
        exit_pupil: mm from the last vertex.
        shift: mm along the axis, for the spots of real rays.
    """

    top: Float[Array, "2"]
    slope: Float[Array, "2"]
    exit_pupil: Float[Array, ""]
    shift: Float[Array, ""]

    def place(self, disparity: Float[Array, ""]) -> Float[Array, ""]:
        """Mm from the last vertex."""
        return (self.top[0] + self.top[1] * disparity) / self._slope(disparity) + self.shift

    def plane(self, normal: Float[Array, "3"], disparity: Float[Array, ""]) -> Float[Array, "3"]:
        """M in 1/mm of the plane in focus.

        Args:
            normal: g, of the film.
            disparity: w_0 in 1/mm.
        """
        across = normal[:2] @ normal[:2] / normal[2]
        level = (disparity - across * self.slope[0]) / (normal[2] + across * self.slope[1])
        return jnp.append(self._slope(level) * normal[:2] / normal[2], level)

    def _slope(self, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return self.slope[0] + self.slope[1] * disparity


def tilted_film(prescription: Prescription, shift: Float[Array, ""]) -> TiltedFilm:
    """The film of a prescription at the line d, moved by `shift` mm along the axis."""
    indices = prescription.indices(line())
    seen = first_order(prescription)
    # Both are ratios of what goes evenly with the disparity: two of them say all.
    ends = jnp.stack([jnp.zeros_like(shift), 0.1 / seen.focal_length])
    places, scales = zip(*(film_distance(prescription, indices, end) for end in ends), strict=True)
    slopes = [-1.0 / scale for scale in scales]
    tops = [place * slope for place, slope in zip(places, slopes, strict=True)]
    top, slope = (jnp.stack([each[0], (each[1] - each[0]) / ends[1]]) for each in (tops, slopes))
    return TiltedFilm(top, slope, seen.exit_pupil, shift)
