"""Distortion and lateral colour: a lens without them, and the resampling that puts them on afterwards."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
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


@jit
def warped(image: Float[Array, "h w 3"], camera: Camera, lens: AbstractLens) -> Float[Array, "h w 3"]:
    """A picture as a lens distorts it, by cubic convolution (Keys 1981); beyond the frame as at its edge.

    Args:
        image: [h, w, 3] linear radiance.
        camera: the frame.
        lens: treats all colours alike.
    """
    height, width = image.shape[:2]
    rows, columns = jnp.meshgrid(jnp.arange(height) + 0.5, jnp.arange(width) + 0.5, indexing="ij")
    points = jnp.stack([columns, rows], axis=-1).reshape(-1, 2).astype(image.dtype)
    places = jax.vmap(lambda point: middle_of(lens, camera, point))(points) - 0.5
    first = jnp.floor(places)
    across, down = ((places - first)[:, axis] for axis in (0, 1))
    column, row = (first[:, axis].astype(int) for axis in (0, 1))
    shares_x, shares_y = _shares(across), _shares(down)
    planes = [image[..., channel].ravel() for channel in range(3)]
    totals = [jnp.zeros_like(planes[0]) for _ in range(3)]
    for dy in range(4):
        line = jnp.clip(row + dy - 1, 0, height - 1) * width
        for dx in range(4):
            index = line + jnp.clip(column + dx - 1, 0, width - 1)
            share = shares_y[dy] * shares_x[dx]
            totals = [total + share * plane[index] for total, plane in zip(totals, planes, strict=True)]
    # Cubic pieces overshoot at edges; there is no light below 0.
    return jnp.maximum(jnp.stack(totals, axis=-1), 0.0).reshape(image.shape)


def _shares(t: Float[Array, " n"]) -> list[Float[Array, " n"]]:
    """Weights of the four pixels around a place, t from the second."""
    u = 1.0 - t
    return [
        -0.5 * t * u * u,
        1.0 + t * t * (1.5 * t - 2.5),
        1.0 + u * u * (1.5 * u - 2.5),
        -0.5 * u * t * t,
    ]
