"""What a solve with a model of close focus refuses (see `lens/_close_focus.py`)."""

import dataclasses

import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Bool

from focusjax._arguments import ArgumentError
from focusjax.focus._checks import require
from focusjax.focus._image_points import ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import CloseFocus, ThinLens, TiltShiftLens

_FREE = ("focus", "f_number")


def refuse_glass(close_focus: CloseFocus) -> None:
    """Refuse a model of close focus for a real lens, which has its own image distance.

    Raises:
        ArgumentError: there is one.
    """
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
    others = [name for name in free if name not in _FREE]
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
