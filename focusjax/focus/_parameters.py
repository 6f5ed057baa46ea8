"""What a solve may change of a lens and camera, as one vector, and back.

The vector holds (focus disparity u, aperture radius E, n_y, n_x, zoom): lengths in metres, n in 1/m of
the plane in focus (0 on an upright lens). Zoom is focal length over starting focal length; E and n
are given for the starting focal length, so that zooming keeps the f-number, tilt and swing.
In these the blur of a point with view tangents (x, y) at disparity w is

    2 f E zoom^p (u + (n_y y + n_x x) / zoom - w),

with p = 1 when the field of view is kept (the sensor grows along) and 2 when it is not.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.focus._image_points import ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import ThinLens, TiltShiftLens, as_tilt_shift, view_tangents

PARAMETERS = ("focus", "f_number", "tilt", "swing", "focal_length")
"""What can be solved for, in the order of the vector."""

FOCUS, RADIUS, TILT, SWING, ZOOM = range(5)


class Start(eqx.Module):
    """The camera and lens before solving, which hold the values of all that is not free.

    Attributes:
        camera: the pinhole that frames the picture.
        lens: thin, or tilt-shift when tilt or swing is free.
        free: parameters to solve for, in the order of `PARAMETERS` (static).
        keep_view: whether the sensor grows with the focal length, so that the field of view stays (static).
    """

    camera: Camera
    lens: ThinLens | TiltShiftLens
    free: tuple[str, ...] = eqx.field(static=True)
    keep_view: bool = eqx.field(static=True)

    @property
    def columns(self) -> tuple[int, ...]:
        """Positions of the free parameters in the vector."""
        return tuple(PARAMETERS.index(name) for name in self.free)

    def vector(self) -> Float[Array, "5"]:
        """All parameters, where the start has them."""
        across = self.lens.plane[:2] if isinstance(self.lens, TiltShiftLens) else jnp.zeros(2)
        radius = self.lens.aperture_radius
        focus = self.lens.focus_disparity
        one = jnp.ones_like(radius)
        return jnp.stack([focus, radius, across[1].astype(one.dtype), across[0].astype(one.dtype), one])

    def whole(self, value: Float[Array, "k"]) -> Float[Array, "5"]:
        """All parameters, with `value` for the free ones."""
        return self.vector().at[jnp.array(self.columns)].set(value)

    def camera_at(self, value: Float[Array, "k"]) -> Camera:
        """The camera with `value` for the free parameters."""
        if "focal_length" not in self.free:
            return self.camera
        zoom = value[self.free.index("focal_length")]
        length = self.camera.focal_length * zoom
        sensor = self.camera.sensor_width * (zoom if self.keep_view else 1.0)
        return dataclasses.replace(self.camera, focal_length=length, sensor_width=sensor)

    def lens_at(self, value: Float[Array, "k"]) -> ThinLens | TiltShiftLens:
        """The lens with `value` for the free parameters."""
        focus, radius, up, right, zoom = self.whole(value)
        if "focal_length" in self.free:
            radius, up, right = radius * zoom, up / zoom, right / zoom
        if isinstance(self.lens, TiltShiftLens):
            plane = jnp.stack([right, up, focus])
            return eqx.tree_at(lambda lens: (lens.plane, lens.aperture_radius), self.lens, (plane, radius))
        return eqx.tree_at(
            lambda lens: (lens.focus_disparity, lens.aperture_radius), self.lens, (focus, radius)
        )

    def points_at(self, value: Float[Array, "k"], points: ImagePoints) -> ImagePoints:
        """The points where the camera with `value` for the free parameters sees them."""
        if "focal_length" not in self.free or self.keep_view:
            return points
        middle, zoom = self.camera.principal_point, value[self.free.index("focal_length")]

        def moved(xy: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
            return middle[None] + zoom * (xy - middle[None])

        reference = points.reference
        if reference is not None:
            reference = jnp.concatenate([moved(reference[:, :2]), reference[:, 2:]], axis=-1)
        return dataclasses.replace(points, xy=moved(points.xy), reference=reference)


def make_start(
    camera: Camera, lens: ThinLens | TiltShiftLens, free: tuple[str, ...], *, keep_view: bool
) -> Start:
    """A start from which tilt and swing can change, when they are free."""
    if "tilt" in free or "swing" in free:
        lens = as_tilt_shift(lens)
    return Start(camera, lens, free, keep_view)


def in_order(free: tuple[str, ...]) -> tuple[str, ...]:
    """The free parameters in the order of `PARAMETERS`.

    Raises:
        ValueError: nothing is free, or something that cannot be.
    """
    if not free or len(set(free)) != len(free) or not set(free) <= set(PARAMETERS):
        raise ValueError(f"free parameters are {list(free)}; expected some of {list(PARAMETERS)}, each once")
    return tuple(name for name in PARAMETERS if name in free)


class BlurModel(eqx.Module):
    """The blur of every point in closed form: quick to evaluate, and to find the best start with.

    Attributes:
        gain: 2 f in pixels.
        across: factors of (n_y, n_x): view tangents of every point, up and to the right.
        disparity: of every point, in 1/m.
        power: exponent of the zoom (static).
    """

    gain: Float[Array, ""]
    across: Float[Array, "n 2"]
    disparity: Float[Array, "n"]
    power: int = eqx.field(static=True)

    def blur(self, parameters: Float[Array, "5"]) -> Float[Array, "n"]:
        """Signed diameters in pixels."""
        focus, radius, up, right, zoom = parameters
        tilted = self.across @ (jnp.stack([up, right]) / zoom)
        scale = self.gain * radius * zoom**self.power
        return scale * (focus + tilted - self.disparity)

    def size(self, parameters: Float[Array, "5"]) -> Float[Array, "n"]:
        """Sum of the sizes of the terms of `blur`, of which rounding is a share."""
        focus, radius, up, right, zoom = jnp.abs(parameters)
        tilted = jnp.abs(self.across) @ (jnp.stack([up, right]) / zoom)
        scale = self.gain * radius * zoom**self.power
        return scale * (focus + tilted + jnp.abs(self.disparity))


def blur_models(points: ImagePoints, start: Start) -> tuple[BlurModel, BlurModel | None]:
    """The blur of the points and that of their references, if there are any."""

    def model(xy: Float[Array, "n 2"], disparity: Float[Array, "n"]) -> BlurModel:
        tangents = jax.vmap(lambda one: view_tangents(start.camera, one))(xy)
        return BlurModel(
            gain=2.0 * start.camera.focal_px,
            across=tangents[:, ::-1],
            disparity=disparity,
            power=1 if start.keep_view else 2,
        )

    own = model(points.xy, points.disparity)
    if points.reference is None:
        return own, None
    return own, model(points.reference[:, :2], points.reference[:, 2])
