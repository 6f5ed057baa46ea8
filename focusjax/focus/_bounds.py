"""How far the solved parameters may go: what a photographer limits, and the box it makes."""

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import ArgumentError
from focusjax._entries import entries, with_entries
from focusjax.focus._checks import known, require_number
from focusjax.geometry import Camera
from focusjax.lens import MAX_TILT, CloseFocus, focus_scale

LOWER_NAMES = (
    "max_focus_distance", "max_f_number", "max_tilt", "min_swing", "min_focal_length",
    "min_shift", "min_rise",
)  # fmt: skip
"""What the lower ends of the box are called: some parameters fall as what is limited grows."""

UPPER_NAMES = (
    "min_focus_distance", "min_f_number", "min_tilt", "max_swing", "max_focal_length",
    "max_shift", "max_rise",
)  # fmt: skip
"""What the upper ends of the box are called."""

LIFE_SIZE = 2.0
"""Default minimum focus distance in focal lengths, where the image is as large as the subject."""

F_NUMBERS = (1.0, 32.0)
"""Range of the f-number when none is given."""

LIMITED = {
    "min_focus_distance": "focus",
    "max_focus_distance": "focus",
    "f_number_range": "f_number",
    "tilt_range": "tilt",
    "swing_range": "swing",
    "focal_length_range": "focal_length",
    "shift_range": "shift",
    "rise_range": "rise",
}
"""Which parameter each limit of `solve` is to."""

Range: TypeAlias = tuple[ArrayLike, ArrayLike]
Ends: TypeAlias = tuple[Float[Array, ""], Float[Array, ""]]


class Box(eqx.Module):
    """Bounds on parameters of a solve (see `_parameters`)."""

    lower: Float[Array, "k"]
    upper: Float[Array, "k"]

    def columns(self, chosen: tuple[int, ...]) -> "Box":
        """The bounds on some of the parameters."""
        return Box(entries(self.lower, chosen), entries(self.upper, chosen))

    def inside(self, value: Float[Array, "k"]) -> Float[Array, "k"]:
        """`value`, cut off at the bounds; what is within rounding of a bound is at it."""
        near = 16.0 * jnp.finfo(value.dtype).eps * (self.upper - self.lower)
        value = jnp.where(value <= self.lower + near, self.lower, value)
        return jnp.where(value >= self.upper - near, self.upper, value)

    def at_radius(self, radius: Float[Array, ""]) -> "Box":
        """The box of (focus, aperture radius) without room for the aperture radius to move."""
        return Box(*(with_entries(end, (1,), (radius,)) for end in (self.lower, self.upper)))


class Limits(eqx.Module):
    """Bounds as they are engraved on a lens and camera.

    Attributes:
        near: minimum focus distance in metres.
        far: maximum focus distance in metres; may be infinite.
        f_number: smallest and largest f-number.
        tilt: least and largest tilt in radians.
        swing: least and largest swing in radians.
        focal_length: shortest and longest focal length in metres.
        shift: least and largest shift in metres.
        rise: least and largest rise in metres.
    """

    near: Float[Array, ""]
    far: Float[Array, ""]
    f_number: Ends
    tilt: Ends
    swing: Ends
    focal_length: Ends
    shift: Ends
    rise: Ends

    def no_wider(self, camera: Camera, widest: Float[Array, ""]) -> "Limits":
        """The same with no opening of a larger radius in metres than `widest`."""
        fastest = jnp.maximum(self.f_number[0], camera.focal_length / (2.0 * widest))
        return dataclasses.replace(self, f_number=(fastest, jnp.maximum(self.f_number[1], fastest)))

    def box(self, camera: Camera, close_focus: CloseFocus = "ignored") -> Box:
        """The same bounds on the whole vector of parameters."""
        length = camera.focal_length
        focus = [1.0 / self.far, 1.0 / self.near]
        if close_focus != "ignored":
            focus = [focus_scale(camera, close_focus).setting(end) for end in focus]
        # n_y = -sin(tilt) / F and, without tilt, n_x = sin(swing) / F.
        up = [-jnp.sin(angle) / length for angle in self.tilt]
        right = [jnp.sin(angle) / length for angle in self.swing]
        radius = [length / (2.0 * number) for number in self.f_number]
        zoom = [end / length for end in self.focal_length]
        return Box(
            lower=jnp.stack([focus[0], radius[1], up[1], right[0], zoom[0], self.shift[0], self.rise[0]]),
            upper=jnp.stack([focus[1], radius[0], up[0], right[1], zoom[1], self.shift[1], self.rise[1]]),
        )


def make_limits(
    camera: Camera,
    *,
    close_focus: CloseFocus = "ignored",
    min_focus_distance: ArrayLike | None = None,
    max_focus_distance: ArrayLike | None = None,
    f_number_range: Range | None = None,
    tilt_range: Range | None = None,
    swing_range: Range | None = None,
    focal_length_range: Range | None = None,
    shift_range: Range | None = None,
    rise_range: Range | None = None,
) -> Limits:
    """Checked limits: in range, and not reversed; arguments as for `solve`."""
    length = camera.focal_length
    shortest, longest = (
        (length, length) if focal_length_range is None else _ends("focal_length_range", focal_length_range)
    )
    shortest = require_number(
        shortest,
        lambda v: v > 0,
        "the focal length range's start in metres",
        "a positive length such as 0.024",
        "focal_length_range.0",
    )
    longest = require_number(
        longest,
        lambda v: (v >= known(shortest)) & (v < np.inf),
        "the focal length range's end in metres",
        "a finite length, not below the range's start",
        "focal_length_range.1",
    )
    # A lens that keeps its image distance as it focuses is never as long as that, nor as its focus distance.
    kept = close_focus == "framing"
    if min_focus_distance is None:
        min_focus_distance = (1.0 if kept else LIFE_SIZE) * known(longest)
    widest, narrowest = _ends("f_number_range", F_NUMBERS if f_number_range is None else f_number_range)
    near = require_number(
        min_focus_distance,
        lambda v: (v > (0.0 if kept else known(longest))) & (v < np.inf),
        "minimum focus distance in metres",
        "a finite distance above 0"
        if kept
        else "a finite distance beyond the focal length; raise it, or use a shorter focal length",
        "min_focus_distance",
    )
    far = require_number(
        np.inf if max_focus_distance is None else max_focus_distance,
        lambda v: v > known(near),
        "maximum focus distance in metres",
        "more than the minimum, or infinity",
        "max_focus_distance",
    )
    widest = require_number(
        widest,
        lambda v: v > 0,
        "the f-number range's start",
        "a positive number such as 1.4",
        "f_number_range.0",
    )
    narrowest = require_number(
        narrowest,
        lambda v: (v > known(widest)) & (v < np.inf),
        "the f-number range's end",
        "a finite number above the range's start; to hold the f-number, leave it out of what is free",
        "f_number_range.1",
    )
    return Limits(
        near=near,
        far=far,
        f_number=(widest, narrowest),
        tilt=_angles("tilt", tilt_range),
        swing=_angles("swing", swing_range),
        focal_length=(shortest, longest),
        shift=_slides("shift", shift_range, camera),
        rise=_slides("rise", rise_range, camera),
    )


def refuse_idle(limits: Mapping[str, Any], free: tuple[str, ...]) -> None:
    """Refuses limits to what is not free, which would limit nothing."""
    for name, parameter in LIMITED.items():
        if limits.get(name) is not None and parameter not in free:
            raise ArgumentError(
                f"{name} is given, but {parameter} is not free, so that it would limit nothing; add"
                f" {parameter!r} to free, or leave {name} out",
                name,
            )


def _ends(name: str, ends: Any) -> Range:
    """The two ends of a range."""
    try:
        least, most = ends
    except (TypeError, ValueError):
        raise ArgumentError(
            f"{name} is {ends!r}; expected two numbers, the least and the most", name
        ) from None
    return least, most


def _slides(name: str, ends: Range | None, camera: Camera) -> Ends:
    """How far the lens may slide; half the sensor's width both ways when nothing is said."""
    if ends is None:
        width = camera.sensor_width
        # A known width is divided without the device, which compiles nothing.
        half = width / 2.0 if isinstance(width, Tracer) else float(width) / 2.0
        ends = (-half, half)
    least, most = _ends(f"{name}_range", ends)
    least = require_number(
        least,
        lambda v: abs(v) < np.inf,
        f"the {name} range's start in metres",
        "a finite length such as -0.011",
        f"{name}_range.0",
    )
    most = require_number(
        most,
        lambda v: (v >= known(least)) & (v < np.inf),
        f"the {name} range's end in metres",
        "a finite length, not below the range's start",
        f"{name}_range.1",
    )
    return least, most


def _angles(name: str, ends: Range | None) -> Ends:
    least, most = (-MAX_TILT, MAX_TILT) if ends is None else _ends(f"{name}_range", ends)
    least = require_number(
        least,
        lambda v: abs(v) < np.pi / 2,
        f"the {name} range's start in radians",
        "an angle between -pi/2 and pi/2",
        f"{name}_range.0",
    )
    most = require_number(
        most,
        lambda v: (v >= known(least)) & (v < np.pi / 2),
        f"the {name} range's end in radians",
        "an angle from the range's start to less than pi/2",
        f"{name}_range.1",
    )
    return least, most
