"""Aberrations as what they add to a ray, with bounds on it, and any lens with some of them."""

import abc
import dataclasses
from functools import reduce
from operator import add

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens, Channel
from focusjax.lens._length import length


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


class AberratedLens(AbstractLens):
    """A lens whose rays are moved by aberrations, which add up.

    With those that offset the focus, an ideal lens has one focal disparity for each place in the picture and
    on the pupil,

        w_f(x, y, r) = w_f(x, y) + field curvature(x, y) + power(r),                     (Lee10 section 5.3)

    and with `ChromaticLens` for each colour; a = p - b w_f as ever. Others offset a in any direction.

    Blur is that of the ideal lens which fits the rays of a round opening best (least squares): where it is 0,
    the spot has its least RMS radius.

    Attributes:
        lens: the lens without them.
        aberrations: one or more.

    Example:
        >>> from focusjax.lens import thin_lens
        >>> from focusjax.lens import power_profile
        >>> thin = thin_lens(focus_distance=2, aperture_radius=0.02)
        >>> soft = AberratedLens(thin, (power_profile([0, 0.03]),))
    """

    lens: AbstractLens
    aberrations: tuple[AbstractAberration, ...]

    def opening(self) -> AbstractAperture:
        return self.lens.opening()

    def vignettes(self) -> bool:
        return self.lens.vignettes()

    def channels(self) -> tuple[Channel, ...]:
        return tuple(
            Channel(dataclasses.replace(self, lens=each.lens), each.colour) for each in self.lens.channels()
        )

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        ray = self.lens.ray(camera, film_point, pupil_point)
        offsets = (one.offset(camera, film_point, pupil_point, ray.b) for one in self.aberrations)
        return dataclasses.replace(ray, a=sum(offsets, ray.a))

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        parallax = self.lens.parallax(camera)
        offsets = (one.defocus(camera, film_point, parallax) for one in self.aberrations)
        return self.lens.blur(camera, film_point, sum((-offset for offset in offsets), disparity))

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        # A focus offset d turns the ray at one disparity into that of the lens at another, less by d, so
        # that the lens's own disks at both ends of the offsets hold all.
        parallax = self.lens.parallax(camera)
        limits = reduce(add, (one.bounds(camera, film_point, parallax) for one in self.aberrations))
        first, wide = self.lens.footprint(camera, film_point, disparity - limits.least)
        second, narrow = self.lens.footprint(camera, film_point, disparity - limits.most)
        apart = 0.5 * length(second - first)
        return 0.5 * (first + second) + limits.shift, jnp.maximum(wide, narrow) + apart + limits.spread

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        parallax = self.lens.parallax(camera)
        limits = reduce(add, (one.overall(camera, parallax) for one in self.aberrations))
        ends = [self.lens.reach(camera, disparity - end) for end in (limits.least, limits.most)]
        return jnp.maximum(*ends) + limits.spread

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return self.lens.parallax(camera)

    def __check_init__(self) -> None:
        if not self.aberrations:
            raise ValueError("an aberrated lens has no aberrations; give one, or use the lens as it is")
