"""Glasses: the refractive index as a function of the wavelength.

Wavelengths are vacuum wavelengths in nanometres everywhere; the dispersion formulas themselves are in
micrometres, as catalogues have them.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

FRAUNHOFER = {
    "i": 365.01,
    "h": 404.6561,
    "g": 435.8343,
    "F'": 479.9914,
    "F": 486.1327,
    "e": 546.0740,
    "d": 587.5618,
    "D": 589.2938,
    "C'": 643.8469,
    "C": 656.2725,
    "r": 706.5188,
}
"""Wavelengths in nm of the spectral lines that glass catalogues refer to."""

RGB_WAVELENGTHS = (650.0, 510.0, 475.0)
"""Wavelengths in nm that stand for red, green and blue (Lee10 section 3)."""


class AbstractGlass(eqx.Module):
    """A medium between two surfaces."""

    @abc.abstractmethod
    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        """Refractive index at a `wavelength` in nm."""


class ConstantIndex(AbstractGlass):
    """A medium without dispersion; air is the index 1.

    Attributes:
        value: the index.
    """

    value: Float[Array, ""]

    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        del wavelength
        return self.value


class Sellmeier(AbstractGlass):
    """n^2 = 1 + offset + sum_i B_i L^2 / (L^2 - C_i), L the wavelength in micrometres.

    Attributes:
        offset: 0 for most glasses.
        strengths: B [t], without a unit.
        poles: C [t] in micrometres squared.
    """

    offset: Float[Array, ""]
    strengths: Float[Array, " t"]
    poles: Float[Array, " t"]

    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        square = (wavelength * 1e-3) ** 2
        return jnp.sqrt(1.0 + self.offset + jnp.sum(self.strengths * square / (square - self.poles)))


class PowerSeries(AbstractGlass):
    """n^2 = constant + sum_i A_i L^(e_i), L the wavelength in micrometres (the Schott form).

    Attributes:
        constant: of the series.
        factors: A [t].
        exponents: e, one for each factor (static).
    """

    constant: Float[Array, ""]
    factors: Float[Array, " t"]
    exponents: tuple[float, ...] = eqx.field(static=True)

    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        exponents = jnp.array(self.exponents, dtype=self.factors.dtype)
        return jnp.sqrt(self.constant + jnp.sum(self.factors * (wavelength * 1e-3) ** exponents))


class Herzberger(AbstractGlass):
    """n = A + B H + C H^2 + D L^2 + E L^4 + F L^6 with H = 1 / (L^2 - 0.028), L in micrometres.

    Attributes:
        factors: A to F [6].
    """

    factors: Float[Array, "6"]

    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        square = (wavelength * 1e-3) ** 2
        pole = 1.0 / (square - 0.028)
        terms = jnp.stack([jnp.ones_like(square), pole, pole**2, square, square**2, square**3])
        return jnp.sum(self.factors * terms)


class Conrady(AbstractGlass):
    """n = n_0 + A / L + B / L^3.5, L the wavelength in micrometres.

    Attributes:
        constant: n_0.
        first: A in micrometres.
        second: B in micrometres^3.5.
    """

    constant: Float[Array, ""]
    first: Float[Array, ""]
    second: Float[Array, ""]

    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        micrometres = wavelength * 1e-3
        return self.constant + self.first / micrometres + self.second * micrometres**-3.5


class ModelGlass(AbstractGlass):
    """A glass known by n_d and V_d only: Cauchy's n = A + B / L^2 through both.

    V_d = (n_d - 1) / (n_F - n_C) fixes B. Between the lines F and C it is within 5e-4 of real glasses of
    the same n_d and V_d (of flints; 3e-5 for crowns); beyond them it knows no partial dispersions.

    Attributes:
        n_d: index at 587.56 nm.
        v_d: Abbe number.
    """

    n_d: Float[Array, ""]
    v_d: Float[Array, ""]

    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        def inverse_square(nanometres: float) -> float:
            return (nanometres * 1e-3) ** -2

        lines = inverse_square(FRAUNHOFER["F"]) - inverse_square(FRAUNHOFER["C"])
        slope = (self.n_d - 1.0) / (self.v_d * lines)
        return self.n_d + slope * ((wavelength * 1e-3) ** -2 - inverse_square(FRAUNHOFER["d"]))


class CauchyGlass(AbstractGlass):
    """A glass known by its indices at a few wavelengths, and by Cauchy's series through them between.

    n = A + B / L^2 + C / L^4 + ... has as many terms as there are indices, and is exact at their wavelengths.

    Attributes:
        indices: n [t].
        wavelengths: of them in nm, all different (static).

    Example:
        >>> glass = CauchyGlass(jnp.array([1.51432, 1.5168, 1.52238]), (656.2725, 587.5618, 486.1327))
        >>> round(float(abbe_number(glass)), 2)
        64.12
    """

    indices: Float[Array, " t"]
    wavelengths: tuple[float, ...] = eqx.field(static=True)

    def index(self, wavelength: Float[Array, ""]) -> Float[Array, ""]:
        # Lagrange's form in 1 / L^2: its factors are near 1, where the coefficients A, B, C differ widely.
        place, places = (wavelength * 1e-3) ** -2, [(each * 1e-3) ** -2 for each in self.wavelengths]
        total = jnp.zeros_like(place)
        for own, index in zip(places, self.indices, strict=True):
            for other in places:
                if other != own:
                    index = index * (place - other) / (own - other)
            total = total + index
        return total


def air() -> ConstantIndex:
    """The medium of index 1, to which catalogues refer their indices."""
    return ConstantIndex(jnp.asarray(1.0, dtype=float))


def abbe_number(glass: AbstractGlass) -> Float[Array, ""]:
    """V_d = (n_d - 1) / (n_F - n_C); infinite without dispersion.

    Example:
        >>> from focusjax.optics import find_glass
        >>> round(float(abbe_number(find_glass("N-BK7"))), 2)
        64.17
    """
    d, f, c = (glass.index(jnp.asarray(FRAUNHOFER[line], dtype=float)) for line in ("d", "F", "C"))
    return (d - 1.0) / (f - c)
