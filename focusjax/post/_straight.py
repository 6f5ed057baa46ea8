"""A lens without its distortion, so that it may be put on afterwards."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens import AbstractLens, AbstractLensWrapper


class StraightenedLens(AbstractLensWrapper):
    """A lens whose middle rays meet, in its focus, where the pinhole's picture has them.

    Blur stays what it is, and vignetting is left out.

    Attributes:
        lens: with its distortion; it treats all colours alike.
    """

    lens: AbstractLens

    def vignettes(self) -> bool:
        return False

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        ray = self.lens.ray(camera, film_point, pupil_point)
        lit = jnp.where(ray.weight > 0.0, 1.0, 0.0)
        moved = ray.a + film_point - middle_of(self.lens, camera, film_point)
        return dataclasses.replace(ray, a=moved, weight=lit)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        centre, radius = self.lens.footprint(camera, film_point, disparity)
        return centre + film_point - middle_of(self.lens, camera, film_point), radius

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return self.lens.reach(camera, disparity)

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return self.lens.parallax(camera)


def middle_of(lens: AbstractLens, camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, "2"]:
    """Where the ray through the middle of the opening looks, in pixels, at the disparity in focus there."""
    ray = lens.ray(camera, film_point, jnp.zeros_like(film_point))
    far, near = (lens.blur(camera, film_point, jnp.full_like(film_point[0], w)) for w in (0.0, 1.0))
    open_ = far != near
    focus = jnp.where(open_, far / jnp.where(open_, far - near, 1.0), 0.0)
    return ray.a + ray.b * focus
