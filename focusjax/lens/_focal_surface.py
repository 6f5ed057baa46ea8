"""A lens whose focus and aperture differ from place to place in the picture."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens
from focusjax.lens._control_points import FocalSurface
from focusjax.lens._thin import ThinLens

_TILE = (16, 32)
"""Rows and columns of places that are worked out together: what they need fits into a core's cache."""


class FocalSurfaceLens(AbstractLens):
    """A thin lens for every film point p: focal disparity w_f(p), aperture radius s(p) E (Lee10 section 5.2).

    Rays are b = f s E v and a = p - b w_f, so blur at disparity w is 2 f E (s w_f - s w). What they are
    made of, s and s w_f, is bilinear between the corners of pixels. At corners the surface is exact; inside
    a pixel the blur is off by at most (|B_xx| + |B_yy|) / 8, with B_xx and B_yy the blur's second derivatives
    per square pixel.

    It is no lens that glass could make: two film points may see the same point of the world
    differently, and every film point receives light as through the whole lens.

    Attributes:
        focus_disparity: w_f in 1/m at pixel corners: [j, i] is at x = i, y = j. Below 0 it lies beyond
            infinity, which blurs everything.
        aperture_scale: s at pixel corners, not negative.
        aperture_radius: E in metres.
        aperture: shape of the opening.
    """

    focus_disparity: Float[Array, "rows columns"]
    aperture_scale: Float[Array, "rows columns"]
    aperture_radius: Float[Array, ""]
    aperture: AbstractAperture

    def pupil_point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        return self.aperture.point(sample)

    def rim_point(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        return self.aperture.rim(turn)

    def pupil_density(self, pupil_point: Float[Array, "2"]) -> Float[Array, ""]:
        return self.aperture.density(pupil_point)

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        scale, offset = self._at(camera, film_point)
        rim = self._full_parallax(camera) * pupil_point
        return LensRay(a=film_point - offset * rim, b=scale * rim, weight=jnp.ones_like(rim[0]))

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        scale, offset = self._at(camera, film_point)
        return 2.0 * self._full_parallax(camera) * (offset - scale * disparity)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        # The size of a bilinear function, so within a pixel it is largest at a corner.
        return film_point, 0.5 * jnp.abs(self.blur(camera, film_point, disparity))

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        farthest, nearest = jnp.min(self.focus_disparity), jnp.max(self.focus_disparity)
        return self.parallax(camera) * jnp.maximum(
            jnp.abs(nearest - disparity), jnp.abs(disparity - farthest)
        )

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return self._full_parallax(camera) * jnp.max(self.aperture_scale)

    def thin_lens_at(self, camera: Camera, film_point: Float[Array, "2"]) -> ThinLens:
        """The thin lens that one film point looks through."""
        scale, offset = self._at(camera, film_point)
        open_ = scale > 0
        focus = jnp.where(open_, offset / jnp.where(open_, scale, 1.0), jnp.mean(self.focus_disparity))
        return ThinLens(focus, scale * self.aperture_radius, self.aperture)

    def _full_parallax(self, camera: Camera) -> Float[Array, ""]:
        return camera.focal_px * self.aperture_radius

    def _at(self, camera: Camera, film_point: Float[Array, "2"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """S and s w_f at a film point; beyond the frame as on its nearest border."""
        rows, columns = self.focus_disparity.shape
        if (columns, rows) != (camera.width + 1, camera.height + 1):
            raise ValueError(
                f"the focal surface was sampled for {columns - 1} x {rows - 1} pixels but the camera has"
                f" {camera.width} x {camera.height}; sample it for this camera"
            )
        (i, u), (j, v) = _cell(film_point[0], camera.width), _cell(film_point[1], camera.height)
        scale, offset = jnp.zeros_like(u), jnp.zeros_like(u)
        for step_j, share_j in ((0, 1.0 - v), (1, v)):
            for step_i, share_i in ((0, 1.0 - u), (1, u)):
                here = j + step_j, i + step_i
                part = share_j * share_i * self.aperture_scale[here]
                scale, offset = scale + part, offset + part * self.focus_disparity[here]
        return scale, offset


def _cell(x: Float[Array, ""], count: int) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """Which of `count` unit intervals holds x, and how far into it x is, 0 to 1."""
    x = jnp.clip(x, 0.0, float(count))
    index = jnp.minimum(jnp.floor(x), count - 1.0)
    return index.astype(int), x - jax.lax.stop_gradient(index)


@eqx.filter_jit
def focal_surface_lens(surface: FocalSurface, camera: Camera, lens: ThinLens) -> FocalSurfaceLens:
    """A lens with a focal surface, sampled at the pixel corners of `camera`.

    Differentiable in the surface's control points, and in what it takes of `lens`.

    Args:
        surface: focal disparity and aperture scale.
        camera: the pinhole that frames the picture.
        lens: aperture radius and shape; its focus is not used.

    Example:
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import focal_surface, thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> thin = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> lens = focal_surface_lens(focal_surface([(10, 20), (50, 20)], [0.5, 1.0]), camera, thin)
        >>> round(float(lens.thin_lens_at(camera, jnp.array([50.0, 20.0])).focus_distance()), 6)
        1.0
    """
    width, height = camera.width + 1, camera.height + 1
    tall, wide = _TILE
    down, across = -(-height // tall), -(-width // wide)

    def tile(number: Int[Array, ""]) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        rows = number // across * tall + jnp.repeat(jnp.arange(tall), wide)
        columns = number % across * wide + jnp.tile(jnp.arange(wide), tall)
        return surface.at(jnp.stack([columns, rows]).astype(surface.xy.dtype))

    def joined(tiles: Float[Array, "tiles p"]) -> Float[Array, "rows columns"]:
        rows = tiles.reshape(down, across, tall, wide).swapaxes(1, 2)
        return rows.reshape(down * tall, across * wide)[:height, :width]

    focus, scale = (joined(tiles) for tiles in jax.lax.map(tile, jnp.arange(down * across)))
    return FocalSurfaceLens(focus, scale, lens.aperture_radius, lens.aperture)
