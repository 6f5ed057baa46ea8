"""What a solve may change of a lens and camera, as one vector, and back.

The vector holds (focus disparity u, aperture radius E, n_y, n_x, zoom, shift, rise): lengths in metres, n
in 1/m of the plane in focus (0 on an upright lens). Zoom is focal length over starting focal length; E and
n are given for the starting focal length, so that zooming keeps the f-number, tilt and swing, and shift and
rise for the starting sensor.
In these the blur of a point with view tangents (x, y) at disparity w is

    2 f E zoom^p (u + (n_y y + n_x x) / zoom - w),

with p = 1 when the field of view is kept (the sensor grows along) and 2 when it is not. Shift and rise slide
the picture and leave x, y and with them all blur as they are; a point is shown, with g pixels per metre, at

    (width / 2 - g shift + zoom^(p - 1) f x,  height / 2 + g rise - zoom^(p - 1) f y).

With a model of close focus (`lens/_close_focus.py`) u is the setting v = w_f / (1 + k w_f) of the focus and
E = f / (2 N), of the stated length f and the f-number N that is set. The blur 2 f E (v (1 + k w) - w) then is
that above, of a point at w / (1 + k w), with the gain 1 + k w; an upright lens at its length is all there is.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax._arguments import ArgumentError
from focusjax._words import did_you_mean
from focusjax.focus._image_points import ACROSS, BLUR, DOWN, ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import (
    CloseFocus,
    FocusScale,
    ThinLens,
    TiltShiftLens,
    as_tilt_shift,
    at_image_distance,
    focus_scale,
    view_tangents,
)

PARAMETERS = ("focus", "f_number", "tilt", "swing", "focal_length", "shift", "rise")
"""What can be solved for, in the order of the vector."""

FRAMING = ("focal_length", "shift", "rise")
"""Those of them that are the camera's, and change where things are shown."""

FOCUS, RADIUS, TILT, SWING, ZOOM, SHIFT, RISE = range(7)

REFERENCE_BLUR = 10.0
"""Diameter in pixels of the blur whose change stands for that of the aperture."""


Parameters: TypeAlias = tuple[Float[Array, ""], ...]
"""All of them, one by one: what is not free then has no slopes, and costs a program nothing."""


def with_free(parameters: Parameters, columns: tuple[int, ...], value: Float[Array, "k"]) -> Parameters:
    """All parameters, with `value` for those at `columns`."""
    return tuple(
        value[columns.index(column)] if column in columns else each for column, each in enumerate(parameters)
    )


class Start(eqx.Module):
    """The camera and lens before solving, which hold the values of all that is not free.

    Attributes:
        camera: the pinhole that frames the picture.
        lens: thin, or tilt-shift when tilt or swing is free.
        free: parameters to solve for, in the order of `PARAMETERS` (static).
        keep_view: whether the sensor grows with the focal length, so that the field of view stays (static).
        close_focus: what stays as the focus moves (static). The camera is of the stated length, and the lens
            has the pupil it has where it is focused.
    """

    camera: Camera
    lens: ThinLens | TiltShiftLens
    free: tuple[str, ...] = eqx.field(static=True)
    keep_view: bool = eqx.field(static=True)
    close_focus: CloseFocus = eqx.field(static=True, default="ignored")

    @property
    def scale(self) -> FocusScale | None:
        """Of the focus, where close focus is not ignored."""
        return None if self.close_focus == "ignored" else focus_scale(self.camera, self.close_focus)

    @property
    def columns(self) -> tuple[int, ...]:
        """Positions of the free parameters in the vector."""
        return tuple(PARAMETERS.index(name) for name in self.free)

    def parameters(self) -> Parameters:
        """All parameters, where the start has them."""
        across = self.lens.plane[:2] if isinstance(self.lens, TiltShiftLens) else jnp.zeros(2)
        radius = self.lens.aperture_radius
        focus = self.lens.focus_disparity
        if (scale := self.scale) is not None:
            focus = scale.setting(focus)
            if self.close_focus == "framing":
                radius = radius / scale.share(focus)
        slide = (self.camera.shift, self.camera.rise)
        rest = (across[1], across[0], jnp.ones_like(radius), *slide)
        return focus, radius, *(one.astype(radius.dtype) for one in rest)

    def first(self) -> Float[Array, "k"]:
        """The free parameters, where the start has them."""
        parameters = self.parameters()
        return jnp.stack([parameters[column] for column in self.columns])

    def whole(self, value: Float[Array, "k"]) -> Parameters:
        """All parameters, with `value` for the free ones."""
        return with_free(self.parameters(), self.columns, value)

    def setting(self, value: Float[Array, "k"]) -> Float[Array, "2"]:
        """Focus disparity and aperture radius, with `value` for the free parameters."""
        whole = self.whole(value)
        return jnp.stack([whole[FOCUS], whole[RADIUS]])

    def camera_at(self, value: Float[Array, "k"]) -> Camera:
        """The camera with `value` for the free parameters."""
        camera = self.camera
        if "focal_length" in self.free:
            zoom = value[self.free.index("focal_length")]
            length = camera.focal_length * zoom
            sensor = camera.sensor_width * (zoom if self.keep_view else 1.0)
            camera = dataclasses.replace(camera, focal_length=length, sensor_width=sensor)
        if (scale := self.scale) is not None:
            focus = scale.disparity(self.whole(value)[FOCUS])
            camera = at_image_distance(camera, focus, self.close_focus)
        return dataclasses.replace(camera, principal_point=self._principal_point(value))

    def lens_at(self, value: Float[Array, "k"]) -> ThinLens | TiltShiftLens:
        """The lens with `value` for the free parameters."""
        focus, radius, up, right, zoom = self.whole(value)[:SHIFT]
        if "focal_length" in self.free:
            radius, up, right = radius * zoom, up / zoom, right / zoom
        if (scale := self.scale) is not None:
            if self.close_focus == "framing":
                radius = radius * scale.share(focus)
            focus = scale.disparity(focus)
        if isinstance(self.lens, TiltShiftLens):
            plane = jnp.stack([right, up, focus])
            return eqx.tree_at(lambda lens: (lens.plane, lens.aperture_radius), self.lens, (plane, radius))
        return eqx.tree_at(
            lambda lens: (lens.focus_disparity, lens.aperture_radius), self.lens, (focus, radius)
        )

    def points_at(self, value: Float[Array, "k"], points: ImagePoints) -> ImagePoints:
        """The points where the camera with `value` for the free parameters sees them."""
        if not reframes(self.free, self.close_focus):
            return points
        before, after = self.camera.principal_point, self._principal_point(value)
        zoom = 1.0 if self.keep_view else self.whole(value)[ZOOM]
        if self.close_focus == "breathing":
            zoom = zoom * self.camera_at(value).focal_length / self.camera.focal_length

        def moved(xy: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
            return after[None] + zoom * (xy - before[None])

        reference = points.reference
        if reference is not None:
            reference = jnp.concatenate([moved(reference[:, :2]), reference[:, 2:]], axis=-1)
        return dataclasses.replace(points, xy=moved(points.xy), reference=reference)

    def _principal_point(self, value: Float[Array, "k"]) -> Float[Array, "2"]:
        """Where the view axis meets the picture, in pixels."""
        point, camera = self.camera.principal_point, self.camera
        density = camera.width / camera.sensor_width
        if "shift" in self.free:
            point = jnp.stack([camera.width / 2 - density * value[self.free.index("shift")], point[1]])
        if "rise" in self.free:
            point = jnp.stack([point[0], camera.height / 2 + density * value[self.free.index("rise")]])
        return point


def reframes(free: Iterable[str], close_focus: CloseFocus) -> bool:
    """Whether a solve moves things in the picture."""
    return bool(set(free) & set(FRAMING)) or close_focus == "breathing"


def make_start(
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    free: tuple[str, ...],
    *,
    keep_view: bool,
    close_focus: CloseFocus = "ignored",
) -> Start:
    """A start from which tilt and swing can change, when they are free."""
    if "tilt" in free or "swing" in free:
        lens = as_tilt_shift(lens)
    return Start(camera, lens, free, keep_view, close_focus)


def scales(start: Start) -> Float[Array, "7"]:
    """Pixels per unit of every parameter: how much a picture through the starting lens changes with each.

    focus          2 f E, the change of every blur;
    f-number       `REFERENCE_BLUR` / E, the change of a blur of that size;
    tilt, swing    E times the picture's height or width, the change of blur at its edge;
    focal length   half the picture's width, the shift of its edge;
    shift, rise    pixels per metre of sensor, the shift of the picture.
    """
    camera, radius = start.camera, start.parameters()[RADIUS]
    safe = jnp.where(radius > 0, radius, 1.0)
    length = camera.focal_length
    density = camera.width / camera.sensor_width
    return jnp.stack(
        [
            2.0 * camera.focal_px * safe,
            REFERENCE_BLUR / safe,
            safe * camera.height,
            safe * camera.width,
            0.5 * camera.width * jnp.ones_like(length),
            density,
            density,
        ]
    )


def in_order(free: str | Sequence[str]) -> tuple[str, ...]:
    """The free parameters in the order of `PARAMETERS`; a single one may be given by its name.

    Raises:
        ArgumentError: nothing is free, or something that cannot be.
    """
    if not isinstance(free, str | Iterable):
        raise ArgumentError(f"free is {free!r}; expected names, some of {list(PARAMETERS)}", "free")
    names = [free] if isinstance(free, str) else list(free)
    if not names or len(set(names)) != len(names) or not set(names) <= set(PARAMETERS):
        known = f"expected some of {list(PARAMETERS)}, each once"
        unknown = [name for name in names if name not in PARAMETERS]
        hint = did_you_mean(str(unknown[0]), PARAMETERS, known) if unknown else known
        raise ArgumentError(f"free parameters are {names}; {hint}", "free")
    return tuple(name for name in PARAMETERS if name in names)


class FrameModel(eqx.Module):
    """Where in the picture points are shown, in closed form, for the rows that wish for that.

    Attributes:
        shown: whether a row is about a place in the picture, and not about blur.
        middle: of the picture across or down, whichever the row is about, in pixels.
        slide: pixels per metre of shift and of rise.
        away: pixels from the principal point at the starting focal length.
        zooms: whether the focal length changes the distance from the principal point (static).
    """

    shown: Bool[Array, "n"]
    middle: Float[Array, "n"]
    slide: Float[Array, "n 2"]
    away: Float[Array, "n"]
    zooms: bool = eqx.field(static=True)

    def place(self, parameters: Parameters) -> Float[Array, "n"]:
        """Pixels across or down."""
        return self.middle + self.slide @ jnp.stack(parameters[SHIFT:]) + self._scale(parameters) * self.away

    def size(self, parameters: Parameters) -> Float[Array, "n"]:
        """Sum of the sizes of the terms of `place`."""
        moved = jnp.abs(self.slide) @ jnp.abs(jnp.stack(parameters[SHIFT:]))
        return self.middle + moved + self._scale(parameters) * jnp.abs(self.away)

    def _scale(self, parameters: Parameters) -> Float[Array, ""] | float:
        return parameters[ZOOM] if self.zooms else 1.0


class BlurModel(eqx.Module):
    """What every row is about in closed form: quick to evaluate, and to find the best start with.

    Attributes:
        gain: 2 f in pixels, or that of every point.
        across: factors of (n_y, n_x): view tangents of every point, up and to the right; None for a lens
            that does not turn.
        disparity: of every point, in 1/m, on the scale of the parameters' focus.
        frame: for rows about places in the picture; None when there are none.
        power: exponent of the zoom; None where the focal length is not free, so that the zoom is 1 (static).
    """

    gain: Float[Array, "*n"]
    across: Float[Array, "n 2"] | None
    disparity: Float[Array, "n"]
    frame: FrameModel | None
    power: int | None = eqx.field(static=True)

    def value(self, parameters: Parameters) -> Float[Array, "n"]:
        """Signed diameters, or places, in pixels."""
        focus = parameters[FOCUS] - self.disparity
        if self.across is not None:
            focus = focus + self.across @ self.tangents(parameters)
        blur = self.scale(parameters) * focus
        if self.frame is None:
            return blur
        return jnp.where(self.frame.shown, self.frame.place(parameters), blur)

    def size(self, parameters: Parameters) -> Float[Array, "n"]:
        """Sum of the sizes of the terms of `value`, of which rounding is a share."""
        focus = jnp.abs(parameters[FOCUS]) + jnp.abs(self.disparity)
        if self.across is not None:
            focus = focus + jnp.abs(self.across) @ jnp.abs(self.tangents(parameters))
        blur = jnp.abs(self.scale(parameters)) * focus
        if self.frame is None:
            return blur
        return jnp.where(self.frame.shown, self.frame.size(parameters), blur)

    def sharp_at(self, parameters: Parameters) -> Float[Array, "n"]:
        """The focus disparity at which every blur changes its sign."""
        if self.across is None:
            return self.disparity
        return self.disparity - self.across @ self.tangents(parameters)

    def scale(self, parameters: Parameters) -> Float[Array, "*n"]:
        """Pixels of blur per 1/m from the plane in focus."""
        scale = self.gain * parameters[RADIUS]
        return scale if self.power is None else scale * parameters[ZOOM] ** self.power

    def tangents(self, parameters: Parameters) -> Float[Array, "2"]:
        """(n_y, n_x) at the focal length of the parameters."""
        turned = jnp.stack(parameters[TILT : SWING + 1])
        return turned if self.power is None else turned / parameters[ZOOM]


def blur_models(points: ImagePoints, start: Start) -> tuple[BlurModel, BlurModel | None]:
    """What the points are about, and the blur of their references, if there are any."""
    power = (1 if start.keep_view else 2) if "focal_length" in start.free else None

    def model(
        xy: Float[Array, "n 2"], disparity: Float[Array, "n"], frame: FrameModel | None = None
    ) -> BlurModel:
        across = None
        if isinstance(start.lens, TiltShiftLens):
            across = jax.vmap(lambda one: view_tangents(start.camera, one))(xy)[:, ::-1]
        gain = 2.0 * start.camera.focal_px
        if (scale := start.scale) is not None:
            # Rows that do not count may be behind the lens, where the scale ends.
            disparity = jnp.where(scale.gain(disparity) > 0.0, disparity, 0.0)
            gain, disparity = gain * scale.gain(disparity), scale.setting(disparity)
        return BlurModel(gain, across, disparity, frame, power)

    own = model(points.xy, points.disparity, _frame_model(points, start))
    if points.reference is None:
        return own, None
    return own, model(points.reference[:, :2], points.reference[:, 2])


def _frame_model(points: ImagePoints, start: Start) -> FrameModel | None:
    if points.quantity is None:
        return None
    camera, across = start.camera, points.quantity == ACROSS
    density = camera.width / camera.sensor_width
    away = points.xy - camera.principal_point[None]
    return FrameModel(
        shown=points.quantity != BLUR,
        middle=jnp.where(across, camera.width / 2.0, camera.height / 2.0).astype(away.dtype),
        slide=jnp.stack(
            [jnp.where(across, -density, 0.0), jnp.where(points.quantity == DOWN, density, 0.0)], axis=1
        ),
        away=jnp.where(across, away[:, 0], away[:, 1]),
        zooms="focal_length" in start.free and not start.keep_view,
    )
