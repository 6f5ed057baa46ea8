"""What a solve refuses before it runs."""

import dataclasses
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from focusjax._arguments import ArgumentError, require_kind
from focusjax._words import shown
from focusjax.focus._bounds import Limits
from focusjax.focus._checks import require
from focusjax.focus._image_points import ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import CloseFocus, ThinLens, TiltShiftLens

Lens = TypeVar("Lens", ThinLens, TiltShiftLens)


def check_start(
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    limits: Limits,
    free: tuple[str, ...],
    close_focus: CloseFocus = "ignored",
) -> None:
    """Refuses a start outside the range of a free parameter, which a silent clamp would hide.

    Raises:
        ValueError: says what starts where.
    """
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((camera, lens, limits))):
        return
    # An end of the range must not be refused for the last bits of its reciprocal or sine.
    slack = 32.0 * float(jnp.finfo(lens.aperture_radius.dtype).eps)
    length = float(camera.focal_length)
    across = (
        np.asarray(lens.plane[:2], dtype=float) * length if isinstance(lens, TiltShiftLens) else (0.0, 0.0)
    )
    with np.errstate(divide="ignore"):
        number = float(length / (2.0 * np.asarray(lens.aperture_radius)))
    if close_focus == "framing":
        number /= 1.0 + length * float(lens.focus_disparity)
    # As `Camera.shift` and `Camera.rise`, by numpy.
    middle = np.array([camera.width, camera.height]) / 2.0
    slide = (middle - np.asarray(camera.principal_point, dtype=float)) * [1.0, -1.0]
    slide = slide * float(camera.sensor_width) / camera.width
    starts = {
        "f_number": ("the starting f-number", number, limits.f_number, "f-number"),
        "tilt": ("the starting tilt in radians", -np.arcsin(across[1]), limits.tilt, "tilt"),
        "swing": ("the starting swing in radians", np.arcsin(across[0]), limits.swing, "swing"),
        "focal_length": ("the starting focal length in metres", length, limits.focal_length, "focal length"),
        "shift": ("the starting shift in metres", slide[0], limits.shift, "shift"),
        "rise": ("the starting rise in metres", slide[1], limits.rise, "rise"),
    }
    for name in free:
        if name in starts:
            what, value, (least, most), kind = starts[name]
            room = slack * max(abs(value), 1e-3)
            if not float(least) - room <= value <= float(most) + room:
                raise ArgumentError(
                    f"{what} is {shown(value)}; expected a value in the {kind} range, {shown(least)} to"
                    f" {shown(most)}; change one of them",
                    f"{name}_range",
                )


def checked_points(points: ImagePoints) -> ImagePoints:
    """The points, with every value in range.

    Raises:
        ValueError: a value that is not, or no point.
    """
    if points.disparity.shape[-1] == 0:
        raise ArgumentError("there are no focus points; give at least one wish", "points")
    weight = require(
        points.weight,
        lambda v: (v >= 0) & (v < np.inf),
        "a focus point's weight",
        "zero or a positive finite number",
        "points",
    )
    weight = require(
        weight,
        lambda v: (v > 0).any(axis=-1),
        "every focus point's weight",
        "at least one that is positive",
        "points",
    )
    disparity = require(
        points.disparity,
        lambda v: (v >= 0) & (v < np.inf),
        "a focus point's disparity",
        "0 (infinity) or a positive finite number of dioptres",
        "points",
    )
    # Known signs go to numpy, as known targets do in `require`: nothing is then compiled for them.
    signed = points.signed if isinstance(points.signed, Tracer) else np.asarray(points.signed)
    target = require(
        points.target,
        lambda v: (abs(v) < np.inf) & (signed | (v >= 0)),
        "a focus point's wished blur",
        "a finite number of pixels, negative only when signed",
        "points",
    )
    return dataclasses.replace(points, weight=weight, disparity=disparity, target=target)


def require_points(points: object, usage: str, *, axes: int) -> None:
    """Refuse what is no set of located wishes, or as many sets as are not expected.

    Args:
        points: what was given.
        usage: the call with its arguments in order.
        axes: 1 for one set, 2 for many.

    Raises:
        ArgumentError: says what to do.
    """
    remedy = "`find_points` or `locate` finds wishes in the picture"
    require_kind(points, ImagePoints, usage, remedy, "points")
    assert isinstance(points, ImagePoints)
    found = jnp.ndim(points.disparity)
    if found != axes:
        remedy = (
            "`solve_many` solves them, and `at` of what it finds is the solution of one"
            if axes == 1
            else "`stacked` puts several together, and `solve` solves one"
        )
        many = "many sets of wishes" if found > 1 else "one set of wishes"
        raise ArgumentError(
            f"points of {usage} are {many}; expected {'one' if axes == 1 else 'many'}: {remedy}", "points"
        )


def require_lens(camera: object, lens: object, usage: str) -> None:
    """Refuse what is no camera, and no lens.

    Raises:
        ArgumentError: says what to do.
    """
    require_kind(camera, Camera, usage, "`look_at` and `make_camera` make one", "camera")
    lenses = (ThinLens, TiltShiftLens)
    require_kind(lens, lenses, usage, "`thin_lens` and `tilt_shift_lens` make one", "lens")


def opened(lens: Lens) -> Lens:
    """The lens, when it is no pinhole, of which no focus can be seen.

    Raises:
        ValueError: it is one.
    """
    radius = require(
        lens.aperture_radius,
        lambda v: (v > 0) & (v < np.inf),
        "the aperture radius in metres",
        "a positive length; a pinhole is sharp everywhere, so open the lens",
        "lens",
    )
    return eqx.tree_at(lambda lens: lens.aperture_radius, lens, radius)
