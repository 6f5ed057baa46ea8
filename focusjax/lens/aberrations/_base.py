"""Aberrations as what they add to a ray, with bounds on it."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera


class Bounds(eqx.Module):
    """Limits of what an aberration adds to the rays of a film point.

    It is -b d + e for rays of parallax b, with the focus offset d between `least` and `most`, each ray having
    its own, and e within `spread` of `shift`.

    Attributes:
        least: least focus offset in 1/m.
        most: largest one.
        shift: pixels.
        spread: pixels.
    """

    least: Float[Array, ""]
    most: Float[Array, ""]
    shift: Float[Array, "2"]
    spread: Float[Array, ""]

    def __add__(self, other: "Bounds") -> "Bounds":
        """Those of two aberrations together."""
        return Bounds(
            self.least + other.least,
            self.most + other.most,
            self.shift + other.shift,
            self.spread + other.spread,
        )


def focus_bounds(least: Float[Array, ""], most: Float[Array, ""]) -> Bounds:
    """Bounds of an aberration that offsets the focus and nothing else."""
    none = jnp.zeros_like(least)
    return Bounds(least, most, jnp.stack([none, none]), none)


class AbstractAberration(eqx.Module):
    """A change of the rays of a lens: where they go at infinity, not where they cross the lens."""

    @abc.abstractmethod
    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        """Pixels added to a, for the ray through `pupil_point` of parallax b in pixels per dioptre."""

    @abc.abstractmethod
    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        """Limits over all rays of a film point with |b| up to `parallax`."""

    @abc.abstractmethod
    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        """Limits over all film points of the picture, with no shift."""

    @abc.abstractmethod
    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        """The focus offset in 1/m that fits its rays best, over a round opening of |b| up to `parallax`."""
