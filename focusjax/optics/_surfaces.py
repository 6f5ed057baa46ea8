"""Refracting surfaces z = sag(x, y): where a ray meets them, and their normals.

Lengths are millimetres. The vertex is the origin, z is along the axis in the direction of the light (from the
scene to the film), and a curvature is positive when its centre is on the film's side. Coordinates are
separate numbers rather than vectors, so that compiled programs keep them in registers.
"""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Real = Float[Array, ""]
_NEWTON_STEPS = 8
MET = 1e-3
"""Millimetres from the surface within which the search for it has succeeded; usually it is at rounding."""
_EDGE = 1e-6


class AbstractSurface(eqx.Module):
    """A surface by its sag. One ray at a time."""

    @abc.abstractmethod
    def sag(self, x: Real, y: Real) -> Real:
        """Height in mm over the vertex plane; a finite number also where the surface does not reach."""

    @abc.abstractmethod
    def meet(self, x: Real, y: Real, u: Real, v: Real, w: Real) -> tuple[Real, Bool[Array, ""]]:
        """Distance in mm from (x, y, 0) along the unit vector (u, v, w) to the surface; whether it is met.

        The distance is finite either way, and negative where the surface is before the vertex plane.
        """

    @abc.abstractmethod
    def normal(self, x: Real, y: Real, z: Real) -> tuple[Real, Real, Real]:
        """A vector along the normal at a point of the surface, with positive z; of any length."""

    @abc.abstractmethod
    def osculating(self) -> tuple[Real, Real]:
        """Curvature c in 1/mm at the vertex, and G in mm^-3, the term of r^4 beyond that of a sphere.

        sag = c r^2 / 2 + (c^3 / 8 + G) r^4 + ...; first-order optics needs c, third-order G as well.
        """

    @abc.abstractmethod
    def scaled(self, factor: Real) -> "AbstractSurface":
        """The surface with all lengths multiplied by `factor`."""


class Conic(AbstractSurface):
    """A sphere or another conic of revolution: c (x^2 + y^2 + (1 + k) z^2) = 2 z, met in closed form.

    Attributes:
        curvature: c in 1/mm; 0 is a plane.
        conic: k; 0 a sphere, -1 a paraboloid, below it a hyperboloid, above an ellipsoid.
    """

    curvature: Float[Array, ""]
    conic: Float[Array, ""]

    def sag(self, x: Real, y: Real) -> Real:
        return _conic_sag(self.curvature, self.conic, x * x + y * y)

    def meet(self, x: Real, y: Real, u: Real, v: Real, w: Real) -> tuple[Real, Bool[Array, ""]]:
        c = self.curvature
        half = w - c * (x * u + y * v)
        offset = c * (x * x + y * y)
        square = half * half - c * (1.0 + self.conic * w * w) * offset
        met = square > 0.0
        # Of the two crossings the one where the ray passes from the vertex's side to the other.
        root = jnp.sqrt(jnp.where(met, square, 1.0))
        below = half + jnp.where(w < 0.0, -root, root)
        met &= below * w > 0.0
        distance = jnp.where(met, offset / jnp.where(met, below, 1.0), 0.0)
        # Beyond the equator is another sheet.
        return distance, met & (1.0 - (1.0 + self.conic) * c * distance * w > 0.0)

    def normal(self, x: Real, y: Real, z: Real) -> tuple[Real, Real, Real]:
        c = self.curvature
        return -c * x, -c * y, 1.0 - (1.0 + self.conic) * c * z

    def osculating(self) -> tuple[Real, Real]:
        return self.curvature, self.conic * self.curvature**3 / 8.0

    def scaled(self, factor: Real) -> "Conic":
        return Conic(self.curvature / factor, self.conic)


class EvenAsphere(AbstractSurface):
    """A conic and a polynomial: sag = conic sag + sum_i A_i r^(2 i), i from 1.

    It is met by Newton's method, whose answer is differentiable as the root that it is.

    Attributes:
        curvature: c in 1/mm of the conic.
        conic: k of the conic.
        coefficients: A_1, A_2, ... [t]: of r^2, r^4 and so on, in mm^(1 - 2 i).
    """

    curvature: Float[Array, ""]
    conic: Float[Array, ""]
    coefficients: Float[Array, " t"]

    def sag(self, x: Real, y: Real) -> Real:
        square = x * x + y * y
        return _conic_sag(self.curvature, self.conic, square) + square * self._series(square)

    def meet(self, x: Real, y: Real, u: Real, v: Real, w: Real) -> tuple[Real, Bool[Array, ""]]:
        start, _ = Conic(self.curvature, self.conic).meet(x, y, u, v, w)
        distance, met = newton(self, start, x, y, u, v, w)
        across = (x + distance * u) ** 2 + (y + distance * v) ** 2
        return distance, met & ((1.0 + self.conic) * self.curvature**2 * across < 1.0 - _EDGE)

    def normal(self, x: Real, y: Real, z: Real) -> tuple[Real, Real, Real]:
        del z
        square = x * x + y * y
        inside = _inside(self.curvature, self.conic, square)
        slope = self.curvature / jnp.sqrt(inside) + 2.0 * self._slope(square)
        return -slope * x, -slope * y, jnp.ones_like(x)

    def osculating(self) -> tuple[Real, Real]:
        c = self.curvature + 2.0 * self.coefficients[0]
        fourth = self.coefficients[1] if self.coefficients.shape[0] > 1 else jnp.zeros_like(c)
        return c, (1.0 + self.conic) * self.curvature**3 / 8.0 + fourth - c**3 / 8.0

    def scaled(self, factor: Real) -> "EvenAsphere":
        powers = factor ** (1.0 - 2.0 * jnp.arange(1, self.coefficients.shape[0] + 1))
        return EvenAsphere(self.curvature / factor, self.conic, self.coefficients * powers)

    def _series(self, square: Real) -> Real:
        """The polynomial over r^2."""
        total = jnp.zeros_like(square)
        for coefficient in self.coefficients[::-1]:
            total = total * square + coefficient
        return total

    def _slope(self, square: Real) -> Real:
        """Its derivative by r^2."""
        total = jnp.zeros_like(square)
        for power in range(self.coefficients.shape[0], 0, -1):
            total = total * square + power * self.coefficients[power - 1]
        return total


def newton(
    surface: AbstractSurface, start: Real, x: Real, y: Real, u: Real, v: Real, w: Real
) -> tuple[Real, Bool[Array, ""]]:
    """Distance along a ray to a surface z = sag(x, y), by Newton's method from `start`.

    The search itself carries no derivatives. Two more steps from its end do: a step from a root has the
    first derivatives of the implicit function theorem, and a second one the second, too.
    """

    def step(_: Any, t: Real) -> Real:
        at_x, at_y = x + t * u, y + t * v
        sag = surface.sag(at_x, at_y)
        nx, ny, nz = surface.normal(at_x, at_y, sag)
        rate = (nx * u + ny * v + nz * w) / nz
        steep = jnp.abs(rate) > 1e-3
        return t - jnp.where(steep, (t * w - sag) / jnp.where(steep, rate, 1.0), 0.0)

    fixed = jax.lax.fori_loop(0, _NEWTON_STEPS, step, start)
    distance = step(0, step(0, jax.lax.stop_gradient(fixed)))
    off = distance * w - surface.sag(x + distance * u, y + distance * v)
    met = jnp.abs(off) < MET
    return jnp.where(met, distance, 0.0), met


def _inside(curvature: Real, conic: Real, square: Real) -> Real:
    """1 - (1 + k) c^2 r^2, kept above 0 where the conic has ended."""
    return jnp.maximum(1.0 - (1.0 + conic) * curvature**2 * square, _EDGE)


def _conic_sag(curvature: Real, conic: Real, square: Real) -> Real:
    return curvature * square / (1.0 + jnp.sqrt(_inside(curvature, conic, square)))


def sphere(curvature: float | Real) -> Conic:
    """A sphere of `curvature` in 1/mm; 0 is a plane."""
    return Conic(jnp.asarray(curvature, dtype=float), jnp.asarray(0.0, dtype=float))
