"""A lens whose focus and aperture differ from place to place in the picture."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens
from focusjax.lens._control_points import FocalSurface, at_corners, corner_weights
from focusjax.lens._thin import ThinLens


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

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=64, height=48, focal_length=0.05)
        >>> thin = fj.thin_lens(focus_distance=5, f_number=2, focal_length=0.05)
        >>> lens = fj.focal_surface_lens(fj.focal_surface([(10, 20), (50, 20)], [0.5, 1.0]), camera, thin)
        >>> lens.focus_disparity.shape, round(float(lens.focus_disparity[20, 50]), 6)
        ((49, 65), 1.0)
    """

    focus_disparity: Float[Array, "rows columns"]
    aperture_scale: Float[Array, "rows columns"]
    aperture_radius: Float[Array, ""]
    aperture: AbstractAperture

    def opening(self) -> AbstractAperture:
        return self.aperture

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
        return ThinLens(self._focus(scale, offset), scale * self.aperture_radius, self.aperture)

    def sampled_for(self, camera: Camera, other: Camera) -> "FocalSurfaceLens":
        """The same surface at the pixel corners of another camera.

        Args:
            camera: whose pixel corners it is sampled at.
            other: has the same frame in fewer or more pixels.
        """
        x, y = (
            jnp.linspace(0.0, size, count + 1)
            for size, count in ((camera.width, other.width), (camera.height, other.height))
        )
        places = jnp.stack(jnp.meshgrid(x, y), axis=-1).astype(self.focus_disparity.dtype)
        scale, offset = jax.vmap(jax.vmap(lambda place: self._at(camera, place)))(places)
        return FocalSurfaceLens(self._focus(scale, offset), scale, self.aperture_radius, self.aperture)

    def _focus(self, scale: Float[Array, "*p"], offset: Float[Array, "*p"]) -> Float[Array, "*p"]:
        """The focal disparity w_f of s and s w_f; where nothing is open, the mean of all."""
        open_ = scale > 0
        return jnp.where(open_, offset / jnp.where(open_, scale, 1.0), jnp.mean(self.focus_disparity))

    def _full_parallax(self, camera: Camera) -> Float[Array, ""]:
        return camera.focal_px * self.aperture_radius

    def _at(self, camera: Camera, film_point: Float[Array, "2"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """S and s w_f at a film point; beyond the frame as on its nearest border."""
        scale, offset = jnp.zeros_like(film_point[0]), jnp.zeros_like(film_point[0])
        for here, share in corner_weights(camera, film_point, self.focus_disparity.shape):
            part = share * self.aperture_scale[here]
            scale, offset = scale + part, offset + part * self.focus_disparity[here]
        return scale, offset


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
    focus, scale = at_corners(surface, camera)
    return FocalSurfaceLens(focus, scale, lens.aperture_radius, lens.aperture)


def surface_blur(
    surface: FocalSurface,
    camera: Camera,
    lens: ThinLens,
    film_point: Float[Array, "2"],
    disparity: Float[Array, ""],
) -> Float[Array, ""]:
    """The blur that `focal_surface_lens` has at a film point, without the lens.

    The surface is evaluated at the four corners of one pixel, not of all.

    Args:
        surface: as for `focal_surface_lens`, as are `camera` and `lens`.
        camera: the pinhole that frames the picture.
        lens: aperture radius and shape; its focus is not used.
        film_point: (x, y) in pixels.
        disparity: of what is seen there, in 1/m.

    Returns:
        Signed diameter in pixels: + behind the focus, - in front of it.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=64, height=48, focal_length=0.05)
        >>> thin = fj.thin_lens(focus_distance=5, f_number=2, focal_length=0.05)
        >>> surface = fj.focal_surface([(10, 20), (50, 20)], [0.5, 1.0])
        >>> place, disparity = jnp.array([50.0, 20.0]), jnp.asarray(0.2)
        >>> blur = surface_blur(surface, camera, thin, place, disparity)
        >>> lens = fj.focal_surface_lens(surface, camera, thin)
        >>> bool(jnp.isclose(blur, lens.blur(camera, place, disparity)))
        True
    """
    corners = corner_weights(camera, film_point, (camera.height + 1, camera.width + 1))
    places = jnp.array([[column for (_, column), _ in corners], [row for (row, _), _ in corners]])
    focus, scale = surface.at(places.astype(film_point.dtype))
    part = scale * jnp.stack([share for _, share in corners])
    return 2.0 * camera.focal_px * lens.aperture_radius * jnp.sum(part * (focus - disparity))
