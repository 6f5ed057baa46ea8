"""Aberrations that give rays different focal disparities: by colour, by zone of the pupil, by place."""

from collections.abc import Sequence
from typing import SupportsFloat

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from focusjax.geometry import Camera
from focusjax.lens._control_points import FocalSurface, at_corners, corner_weights
from focusjax.lens._length import length
from focusjax.lens._spline import RadialSpline, radial_spline
from focusjax.lens.aberrations._base import AbstractAberration, Bounds, focus_bounds


class FocusOffset(AbstractAberration):
    """Another focal disparity for all rays: axial colour, when each channel has its own.

    Attributes:
        dioptres: 1/m added to the focal disparity; positive focuses nearer.
    """

    dioptres: Float[Array, ""]

    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        del camera, film_point, pupil_point
        return -b * self.dioptres

    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        del film_point
        return self.overall(camera, parallax)

    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        del camera, parallax
        return focus_bounds(self.dioptres, self.dioptres)

    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        del camera, film_point, parallax
        return self.dioptres


class PowerProfile(AbstractAberration):
    """Refractive power that differs over the radius of the pupil: spherical aberration of any kind.

    A zone at radius r (a share of the aperture radius, also when stopped down) has its focus at
    w_f + dioptres(r). Power that rises towards the rim is under-corrected spherical aberration, as of a
    simple lens: what lies behind the focus gets a bright core and a soft edge, what lies before it a bright
    rim (Kyaw 6.3.1). Power that falls is over-corrected: the other way round.

    Attributes:
        dioptres: focus offset in 1/m over r.
    """

    dioptres: RadialSpline

    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        del camera, film_point
        return -b * self.dioptres(length(pupil_point))

    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        del film_point
        return self.overall(camera, parallax)

    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        del camera, parallax
        return focus_bounds(*self.dioptres.extent())

    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        del camera, film_point, parallax
        return self.dioptres.defocus()


def power_profile(dioptres: ArrayLike | Sequence[SupportsFloat]) -> PowerProfile:
    """A `PowerProfile` from focus offsets in 1/m at evenly spaced radii, from the middle to the rim.

    Two values are the classical third order: [0, c] is c r^2.

    Raises:
        ValueError: fewer than two values, or one that is not finite.
    """
    return PowerProfile(radial_spline(dioptres))


class FieldCurvature(AbstractAberration):
    """A focal disparity that differs over the picture from the lens's own, by a surface of offsets.

    Attributes:
        dioptres: focus offset in 1/m at pixel corners: [j, i] is at x = i, y = j; bilinear between.
    """

    dioptres: Float[Array, "rows columns"]

    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        del pupil_point
        return -b * self._at(camera, film_point)

    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        del parallax
        here = self._at(camera, film_point)
        return focus_bounds(here, here)

    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        del camera, parallax
        return focus_bounds(jnp.min(self.dioptres), jnp.max(self.dioptres))

    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        del parallax
        return self._at(camera, film_point)

    def _at(self, camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, ""]:
        corners = corner_weights(camera, film_point, self.dioptres.shape)
        return sum((part * self.dioptres[here] for here, part in corners), jnp.zeros_like(film_point[0]))


def field_curvature(offsets: FocalSurface, camera: Camera) -> FieldCurvature:
    """A `FieldCurvature` through control points (Lee10 section 5.3), by moving least squares.

    Differentiable in the control points.

    Args:
        offsets: its `focus_disparity` are offsets in 1/m here; its aperture scale is not used.
        camera: the pinhole that frames the picture.
    """
    return FieldCurvature(at_corners(offsets, camera)[0])
