"""How far the solved parameters may go: what a photographer limits, and the box it makes."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax.focus._checks import require
from focusjax.geometry import Camera

LOWER_NAMES = ("max_focus_distance", "max_f_number")
"""What the lower ends of the box are called: its parameters are reciprocals of what is limited."""

UPPER_NAMES = ("min_focus_distance", "min_f_number")
"""What the upper ends of the box are called."""

LIFE_SIZE = 2.0
"""Default minimum focus distance in focal lengths, where the image is as large as the subject."""


class Box(eqx.Module):
    """Bounds on (focus disparity in 1/m, aperture radius in m)."""

    lower: Float[Array, "2"]
    upper: Float[Array, "2"]

    def at_radius(self, radius: Float[Array, ""]) -> "Box":
        """The box without room for the aperture radius to move."""
        return Box(self.lower.at[1].set(radius), self.upper.at[1].set(radius))


class Limits(eqx.Module):
    """Bounds as they are engraved on a lens.

    Attributes:
        near: minimum focus distance in metres.
        far: maximum focus distance in metres; may be infinite.
        widest: smallest f-number.
        narrowest: largest f-number.
    """

    near: Float[Array, ""]
    far: Float[Array, ""]
    widest: Float[Array, ""]
    narrowest: Float[Array, ""]

    def box(self, camera: Camera) -> Box:
        """The same bounds on the parameters that are solved for."""
        length = camera.focal_length
        return Box(
            lower=jnp.stack([1.0 / self.far, length / (2.0 * self.narrowest)]),
            upper=jnp.stack([1.0 / self.near, length / (2.0 * self.widest)]),
        )


def make_limits(
    camera: Camera,
    *,
    min_focus_distance: ArrayLike | None,
    max_focus_distance: ArrayLike,
    f_number_range: tuple[ArrayLike, ArrayLike],
) -> Limits:
    """Checked limits; arguments as for `solve`.

    Raises:
        ValueError: limits that are out of range or reversed.
    """
    length = camera.focal_length
    if min_focus_distance is None:
        min_focus_distance = LIFE_SIZE * length
    near = jnp.asarray(min_focus_distance, dtype=float)
    far = jnp.asarray(max_focus_distance, dtype=float)
    widest = jnp.asarray(f_number_range[0], dtype=float)
    narrowest = jnp.asarray(f_number_range[1], dtype=float)
    return Limits(
        near=require(
            near,
            lambda v: (v > length) & (v < np.inf),
            "minimum focus distance in metres",
            "a finite distance beyond the focal length; raise it, or use a shorter focal length",
        ),
        far=require(
            far, lambda v: v > near, "maximum focus distance in metres", "more than the minimum, or infinity"
        ),
        widest=require(
            widest, lambda v: v > 0, "the f-number range's start", "a positive number such as 1.4"
        ),
        narrowest=require(
            narrowest,
            lambda v: (v > widest) & (v < np.inf),
            "the f-number range's end",
            "a finite number above the range's start",
        ),
    )
