"""Another size of the picture: lateral colour, when each channel has its own."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.lens.aberrations._base import AbstractAberration, Bounds, frame_corners


class Magnification(AbstractAberration):
    """A picture larger about the principal point than that of the lens, in focus and out of it.

    Attributes:
        scale: how many times larger, near 1.
    """

    scale: Float[Array, ""]

    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        # The film point gets what the lens alone would have sent nearer the middle.
        del pupil_point, b
        return (film_point - camera.principal_point) * (1.0 / self.scale - 1.0)

    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        del parallax
        none = jnp.zeros_like(film_point[0])
        return Bounds(none, none, self.offset(camera, film_point, film_point, film_point), none)

    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        del parallax
        away = jnp.abs(frame_corners(camera, self.scale.dtype) - camera.principal_point[None]).max()
        none = jnp.zeros_like(away)
        return Bounds(none, none, jnp.stack([none, none]), away * jnp.abs(1.0 / self.scale - 1.0))

    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        del camera, parallax
        return jnp.zeros_like(film_point[0])
