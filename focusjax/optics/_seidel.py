"""Third-order (Seidel) aberrations by surfaces (Welford, Aberrations of Optical Systems, chapter 8).

With the refraction invariants A = n (h c + u) of the marginal ray and Ab = n (hb c + ub) of the chief ray,
the Lagrange invariant H = n (u hb - ub h), and D(q) = q' - q across a surface of curvature c:

    S_I = -A^2 h D(u/n)          S_II = -A Ab h D(u/n)       S_III = -Ab^2 h D(u/n)
    S_IV = -H^2 c D(1/n)         S_V = -Ab^3 h D(1/n^2) + Ab c hb (2 Ab h - A hb) D(1/n)
    C_I = A h D(dn/n)            C_II = Ab h D(dn/n)

A term G r^4 of the sag beyond the sphere's adds 8 G D(n) h^4 to S_I, and that times the powers of hb / h to
S_II, S_III and S_V. All are lengths, in mm; the wavefront at the edge of field and pupil is W040 = S_I / 8,
W131 = S_II / 2, W222 = S_III / 2, W220 = (S_III + S_IV) / 4, W311 = S_V / 2.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.optics._paraxial import first_order
from focusjax.optics._prescription import Prescription, line


class SeidelSums(eqx.Module):
    """The Seidel contributions of each surface, in mm; sum over the axis for those of the lens.

    Attributes:
        spherical: S_I [n].
        coma: S_II [n].
        astigmatism: S_III [n].
        petzval: S_IV [n].
        distortion: S_V [n].
        axial_colour: C_I [n], from the line C to F.
        lateral_colour: C_II [n].
    """

    spherical: Float[Array, "*n"]
    coma: Float[Array, "*n"]
    astigmatism: Float[Array, "*n"]
    petzval: Float[Array, "*n"]
    distortion: Float[Array, "*n"]
    axial_colour: Float[Array, "*n"]
    lateral_colour: Float[Array, "*n"]

    def wavefront(self) -> dict[str, Float[Array, ""]]:
        """Coefficients in mm of the lens's wavefront: the five, and W020 and W111 by colour."""
        one, two, three, four, five = (
            jnp.sum(part)
            for part in (self.spherical, self.coma, self.astigmatism, self.petzval, self.distortion)
        )
        return {
            "W040": one / 8.0,
            "W131": two / 2.0,
            "W222": three / 2.0,
            "W220": (three + four) / 4.0,
            "W311": five / 2.0,
            "W020_colour": jnp.sum(self.axial_colour) / 2.0,
            "W111_colour": jnp.sum(self.lateral_colour),
        }


@jit
def seidel_sums(
    lens: Prescription,
    *,
    field: float | Float[Array, ""],
    wavelength: Float[Array, ""] | None = None,
    object_distance: float = float("inf"),
) -> SeidelSums:
    """Seidel contributions for the lens's own stop.

    Args:
        lens: in mm.
        field: angle of the chief ray to the axis at the entrance pupil, in radians.
        wavelength: nm; that of the line d if None.
        object_distance: mm from the entrance pupil; infinite by default.

    Example:
        >>> lens = fj.lens_preset("cooke_triplet_50mm_f4")
        >>> sums = seidel_sums(lens, field=0.35)
        >>> bool(abs(sums.coma.sum()) < 0.1 * abs(sums.coma).max())
        True
    """
    seen = first_order(lens, wavelength)
    n = lens.indices(line() if wavelength is None else wavelength)
    blue, red = (lens.indices(line(name)) for name in ("F", "C"))
    spread = (blue - red) / n
    slope = seen.entrance_pupil_radius / object_distance
    # At the first vertex, from the axial point of the object and from the middle of the pupil.
    h = seen.entrance_pupil_radius - slope * seen.entrance_pupil
    u = slope
    ub = jnp.tan(jnp.asarray(field, dtype=n.dtype))
    hb = -ub * seen.entrance_pupil
    shapes = [surface.osculating() for surface in lens.surfaces]
    curvatures, fourths = (jnp.stack(column) for column in zip(*shapes, strict=True))

    def step(rays: tuple[Array, ...], surface: tuple[Array, ...]) -> tuple[tuple[Array, ...], SeidelSums]:
        h, u, hb, ub = rays
        c, fourth, before, after, colour, gap = surface
        bend = c * (after - before)
        u_after, ub_after = (before * u - h * bend) / after, (before * ub - hb * bend) / after
        A, Ab, H = before * (h * c + u), before * (hb * c + ub), before * (u * hb - ub * h)
        by_slope, by_index = u_after / after - u / before, 1.0 / after - 1.0 / before
        by_square = 1.0 / after**2 - 1.0 / before**2
        figure = 8.0 * fourth * (after - before)
        bent = Ab * c * hb * (2.0 * Ab * h - A * hb) * by_index
        sums = SeidelSums(
            spherical=-(A**2) * h * by_slope + figure * h**4,
            coma=-A * Ab * h * by_slope + figure * h**3 * hb,
            astigmatism=-(Ab**2) * h * by_slope + figure * h**2 * hb**2,
            petzval=-(H**2) * c * by_index,
            distortion=-(Ab**3) * h * by_square + bent + figure * h * hb**3,
            axial_colour=A * h * colour,
            lateral_colour=Ab * h * colour,
        )
        return (h + gap * u_after, u_after, hb + gap * ub_after, ub_after), sums

    surfaces = (curvatures, fourths, n[:-1], n[1:], spread[1:] - spread[:-1], lens.thicknesses)
    return jax.lax.scan(step, (h, u, hb, ub), surfaces)[1]
