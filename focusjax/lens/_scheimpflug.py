"""Between the plane in focus and the movements of a view camera: closed forms, no iteration.

All follows from n = u / F - e_z / s (`focusjax.lens._tilt_shift` derives it), with the lens axis

    u = (cos(tilt) sin(swing), -sin(tilt), cos(tilt) cos(swing)).
"""

import math
from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import real_number, real_numbers
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._length import root

MAX_TILT = math.pi / 4
"""Default limit of constructors for the angle from the sensor's normal to the lens's axis, in radians."""

_THROUGH = 1e-6
"""Sine of the angle below which a plane through a point is taken to contain the lens centre as well."""


class Movements(eqx.Module):
    """What the knobs of the camera say.

    Attributes:
        tilt: radians; positive leans the lens forward, its axis down.
        swing: radians; positive turns the lens's axis to the right.
        image_distance: metres from the lens centre to the sensor, along the sensor's normal.
        focus_distance: metres from the lens centre to the plane in focus, along the same line; infinite if
            they are parallel, and negative when they meet behind the lens.
        hinge_distance: metres from the lens centre to the line about which focusing turns the plane; infinite
            without tilt and swing.
    """

    tilt: Float[Array, ""]
    swing: Float[Array, ""]
    image_distance: Float[Array, ""]
    focus_distance: Float[Array, ""]
    hinge_distance: Float[Array, ""]


def view_tangents(camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, "2"]:
    """(X / Z, Y / Z) of what is seen at `film_point` (pixels)."""
    away = (film_point - camera.principal_point) / camera.focal_px
    return away * jnp.array([1.0, -1.0], dtype=away.dtype)


def turn_to(axis: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The smallest rotation that takes (0, 0, 1) to a unit vector, so that no roll comes in."""
    x, y, z = axis
    fold = 1.0 / (1.0 + z)
    return jnp.stack(
        [
            jnp.stack([1.0 - x * x * fold, -x * y * fold, x]),
            jnp.stack([-x * y * fold, 1.0 - y * y * fold, y]),
            jnp.stack([-x, -y, z]),
        ]
    )


def lens_axis(plane: Float[Array, "3"], focal_length: Float[Array, ""]) -> Float[Array, "3"]:
    """The unit axis u of the lens that focuses on `plane`; at right angles to z beyond what one can reach."""
    across = focal_length * plane[:2]
    return jnp.append(across, root(1.0 - across @ across))


@jit
def movements_of(plane: Float[Array, "3"], focal_length: Float[Array, ""]) -> Movements:
    """Tilt, swing and distances that focus a lens of `focal_length` (metres) on `plane` (n, 1/m)."""
    axis = lens_axis(plane, focal_length)
    square = plane[:2] @ plane[:2]
    tilted = square > 0.0
    return Movements(
        tilt=-jnp.arcsin(axis[1]),
        swing=jnp.arctan2(axis[0], axis[2]),
        image_distance=1.0 / (axis[2] / focal_length - plane[2]),
        focus_distance=1.0 / plane[2],
        hinge_distance=jnp.where(tilted, 1.0 / jnp.sqrt(jnp.where(tilted, square, 1.0)), jnp.inf),
    )


def plane_of(focus_distance: float, focal_length: float, tilt: float, swing: float) -> Float[np.ndarray, "3"]:
    """N [3] in 1/m of a tilted lens; lengths in metres, angles in radians.

    Raises:
        ValueError: an angle that is not between -pi/2 and pi/2.
    """
    for name, angle in (("tilt", tilt), ("swing", swing)):
        if not abs(angle) < math.pi / 2:
            raise ValueError(f"{name} is {angle} rad; expected an angle between -pi/2 and pi/2")
    across = np.array([math.cos(tilt) * math.sin(swing), -math.sin(tilt)]) / focal_length
    return np.append(across, 1.0 / focus_distance)


def focal_plane_through(
    point: ArrayLike | Sequence[float], normal: ArrayLike | Sequence[float]
) -> Float[Array, "3"]:
    """N [3] in 1/m of the plane through `point` (metres) at right angles to `normal`, both in camera axes.

    Camera axes are X right, Y up, Z forward.

    Raises:
        ValueError: a plane through the lens centre, which no lens can focus on; values that are not finite.

    Example:
        >>> [round(float(v), 3) for v in focal_plane_through((0, -1.5, 4), (0, 1, 0))]
        [0.0, -0.667, 0.0]
    """
    place, across = (
        real_numbers(value, f"the plane's {name}", "three finite numbers")
        for name, value in (("point", point), ("normal", normal))
    )
    for name, value in (("point", place), ("normal", across)):
        if value.shape != (3,) or not np.all(np.isfinite(value)):
            raise ValueError(f"the plane's {name} is {value.tolist()}; expected three finite numbers")
    reach = across @ place
    if not abs(reach) > _THROUGH * np.linalg.norm(across) * np.linalg.norm(place):
        raise ValueError(
            f"the plane through {place.tolist()} m with normal {across.tolist()} contains the lens centre; it"
            " is seen edge-on and no lens can focus on it, so move the camera off it or turn the plane"
        )
    return jnp.asarray(across / reach + 0.0, dtype=float)


def check_plane(plane: ArrayLike, focal_length: float, max_tilt: SupportsFloat) -> None:
    """Refuse what a lens of `focal_length` cannot be focused on with at most `max_tilt` radians.

    Raises:
        ValueError: says why.
    """
    n = real_numbers(plane, "the plane in focus in 1/m", "three finite numbers")
    if n.shape != (3,) or not np.all(np.isfinite(n)):
        raise ValueError(f"the plane in focus is {n.tolist()} 1/m; expected three finite numbers")
    most = real_number(max_tilt, "the tilt limit in radians", "0 up to less than pi/2")
    if not 0 <= most < math.pi / 2:
        raise ValueError(f"the tilt limit is {max_tilt} rad; expected 0 up to less than pi/2")
    hinge = math.inf if not np.any(n[:2]) else 1.0 / float(np.hypot(*n[:2]))
    sine = focal_length / hinge
    away = 1.0 / float(np.linalg.norm(n)) if np.any(n) else math.inf
    where = f"the plane in focus passes {away:.4g} m from the lens centre"
    if sine >= 1:
        raise ValueError(
            f"{where}, with its hinge at {hinge:.4g} m, within the focal length {focal_length:.4g} m, so that"
            " no tilt reaches it; use a shorter focal length, or a plane farther from the lens centre"
        )
    angle = math.asin(sine)
    # A tilt that is given as the limit itself must not fail by rounding.
    if angle > most + 1e-6:
        raise ValueError(
            f"{where}, which takes a tilt of {math.degrees(angle):.4g} degrees in all; the limit"
            f" is {math.degrees(most):.4g}, so use a shorter focal length, or a plane farther from the"
            " lens centre"
        )
    if n[2] >= math.cos(angle) / focal_length:
        raise ValueError(
            f"the plane in focus meets the view axis at {1.0 / n[2]:.4g} m, within"
            f" {focal_length / math.cos(angle):.4g} m, where the tilted lens forms no real image; focus"
            " farther away or use a shorter focal length"
        )
