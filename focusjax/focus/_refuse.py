"""What a solve refuses before it runs."""

import dataclasses
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool

from focusjax._arguments import ArgumentError, require_kind
from focusjax._words import kind_of, shown
from focusjax.focus._bounds import Limits
from focusjax.focus._checks import require
from focusjax.focus._image_points import ImagePoints
from focusjax.focus._solution import Asked
from focusjax.geometry import Camera
from focusjax.lens import (
    AbstractLens,
    CloseFocus,
    FittedLens,
    PrescriptionLens,
    SpectralLens,
    ThinLens,
    TiltedPrescriptionLens,
    TiltShiftLens,
    nearest_focus,
    pupil_radius,
)

Lens = TypeVar("Lens", ThinLens, TiltShiftLens)

_WIDER = 1e-3
"""Share by which an f-number may be wider than the glass, as engraved ones are rounded."""


def check_start(
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    limits: Limits,
    free: tuple[str, ...],
    close_focus: CloseFocus = "ignored",
) -> None:
    """Refuses a start outside the range of a free parameter, which a silent clamp would hide."""
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
    """The points, of which there are some, with every value in range."""
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
    """Refuses what is no set of located wishes, or not as many as expected: one for 1 of `axes`, many for 2.

    `usage` is the call with its arguments in order.
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
    """Refuses what is no camera, and no lens."""
    require_kind(camera, Camera, usage, "`look_at` and `make_camera` make one", "camera")
    lenses = (ThinLens, TiltShiftLens)
    require_kind(lens, lenses, usage, "`thin_lens` and `tilt_shift_lens` make one", "lens")


def opened(lens: Lens) -> Lens:
    """The lens, when it is no pinhole, of which no focus can be seen."""
    radius = require(
        lens.aperture_radius,
        lambda v: (v > 0) & (v < np.inf),
        "the aperture radius in metres",
        "a positive length; a pinhole is sharp everywhere, so open the lens",
        "lens",
    )
    return eqx.tree_at(lambda lens: lens.aperture_radius, lens, radius)


def checked_glass(glass: object, asked: Asked, usage: str = "solve(through=)") -> AbstractLens:
    """`glass`, when the problem can be solved through it.

    Raises:
        ArgumentError: another kind of lens, a solver, something free that glass does not have, a start wider
            than the glass, or a closest focus that it does not reach.
    """
    kinds = (PrescriptionLens, SpectralLens, FittedLens, TiltedPrescriptionLens)
    remedy = "`prescription_lens`, `spectral_lens` and `tilted_lens` make one"
    require_kind(glass, kinds, usage, remedy, "through")
    assert isinstance(glass, AbstractLens)
    if asked.plan.solver is not None:
        raise ArgumentError(
            f"solver is {kind_of(asked.plan.solver)}; blur through glass has one solver, so leave it out",
            "solver",
        )
    others = [name for name in asked.plan.free if name not in ("focus", "f_number")]
    if others:
        raise ArgumentError(
            f"free has {others[0]!r}, which is not solved for through glass; solve for it without `through`"
            " first, make the glass for the camera and turn it (`tilted_lens`) as found, and leave it out",
            "free",
        )
    if not isinstance(asked.lens, ThinLens):
        raise ArgumentError(
            "the starting lens is turned; start with a thin lens, and turn the glass (`tilted_lens`)", "lens"
        )
    leaves = jax.tree.leaves((glass, asked.camera, asked.lens, asked.limits))
    if any(isinstance(leaf, Tracer) for leaf in leaves):
        return glass
    length = float(asked.camera.focal_length)
    widest = length / (2.0 * float(pupil_radius(glass)))
    starts = length / (2.0 * max(float(asked.lens.aperture_radius), 1e-30))
    if starts < widest * (1.0 - _WIDER):
        raise ArgumentError(
            f"the starting f-number is {shown(starts)}, and the glass is open to f/{widest:.3g}; open the"
            " glass as far as the solve may go, or start with a larger f-number",
            "lens",
        )
    near, nearest = float(asked.limits.near), float(nearest_focus(glass))
    if near <= nearest and "focus" in asked.plan.free:
        raise ArgumentError(
            f"the minimum focus distance is {shown(near)} m, and the glass focuses no nearer than"
            f" {nearest:.3g} m from its entrance pupil; raise it",
            "min_focus_distance",
        )
    return glass


def refuse_glass(close_focus: CloseFocus) -> None:
    """Refuses a model of close focus for a real lens, which has its own image distance."""
    if close_focus != "ignored":
        raise ArgumentError(
            f"close_focus is {close_focus!r}, and `through` is a real lens, whose glass says how its image"
            " distance and framing change; leave close_focus out",
            "close_focus",
        )


def checked_close_focus(
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    free: tuple[str, ...],
    priors: tuple[str, ...],
    close_focus: CloseFocus,
) -> ImagePoints:
    """The points, of a problem that a model of close focus can be solved with.

    Raises:
        ArgumentError: something else than focus and f-number is free, a tilted lens, a prior of the focus, a
            wish for a place in a picture whose size changes, or a place that the lens has no real image of.
    """
    others = [name for name in free if name not in ("focus", "f_number")]
    if others:
        raise ArgumentError(
            f"close_focus is {close_focus!r} and {others[0]!r} is free; only the focus and the f-number of an"
            " upright lens at its length are solved for with it, so leave one of them out",
            "close_focus",
        )
    if isinstance(lens, TiltShiftLens):
        raise ArgumentError(
            f"close_focus is {close_focus!r} and the lens is a TiltShiftLens, which has another image"
            " distance at every tilt; use a ThinLens, or leave close_focus out",
            "close_focus",
        )
    if "focus" in priors:
        raise ArgumentError(
            f"close_focus is {close_focus!r} and the focus has a prior, which is linear in dioptres while the"
            " blur is not; leave one of them out",
            "close_focus",
        )
    if close_focus == "breathing" and points.quantity is not None:
        raise ArgumentError(
            "close_focus is 'breathing', where the focus moves everything in the picture, and a wish is for"
            " the place where something is shown; use 'framing', or leave that wish out",
            "close_focus",
        )
    if close_focus != "breathing":
        return points
    return _with_real_images(points, camera, lens)


def _nearest_of(points: ImagePoints, counted: Bool[Array, "*p n"]) -> str:
    """What to call the nearest focus point that counts."""
    nearness = jnp.where(counted, points.disparity, 0.0)
    if isinstance(nearness, Tracer) or not points.names:
        return "a focus point"
    return repr(points.names[int(points.wish.reshape(-1)[jnp.argmax(nearness)])])


def _with_real_images(points: ImagePoints, camera: Camera, lens: ThinLens) -> ImagePoints:
    """The points, all of which are beyond the focal length where they count; so is what is in focus."""
    expected = "less than 1, since nearer than its focal length no lens forms a real image; move farther away"
    length = camera.focal_length
    require(
        lens.focus_disparity * length,
        lambda v: v < 1.0,
        "the focal length over the starting focus distance",
        expected,
        "lens",
    )
    counted = points.weight > 0
    nearness = require(
        jnp.where(counted, points.disparity, 0.0) * length,
        lambda v: v < 1.0,
        f"the focal length over the distance of {_nearest_of(points, counted)}",
        expected,
        "points",
    )
    if not isinstance(nearness, Tracer):
        return points
    # So that what is checked when compiled code runs is not left out of it.
    return dataclasses.replace(points, disparity=points.disparity + 0.0 * nearness)
