"""Functions of image height, through tables."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import real_numbers
from focusjax._monotone_cubic import monotone_cubic

_LARGEST = 1e9
"""Of a table's values, so that slopes and squares of them fit single precision."""


class HeightCurve(eqx.Module):
    """A function of the distance from the axis on the film. `height_curve` makes one.

    It passes through its table by cubic pieces that rise and fall only where the table does, so that it is
    never beyond what was measured. Past the table's end its last line goes on. Differentiable in height and
    values.

    Attributes:
        reach: metres from the axis to the table's end.
        places: [k] shares of it, rising from 0 to 1.
        values: [k] there.
        even: whether it is the same on both sides of the axis, so that it starts level; else it changes its
            sign there and starts along the first line (static).
    """

    reach: Float[Array, ""]
    places: Float[Array, " k"]
    values: Float[Array, " k"]
    even: bool = eqx.field(static=True)

    def __call__(self, height: Float[Array, ""]) -> Float[Array, ""]:
        """The value at a height in metres."""
        place = height / self.reach
        inside = monotone_cubic(self.places, self.values, place, level_start=self.even)
        slope = (self.values[-1] - self.values[-2]) / (self.places[-1] - self.places[-2])
        return inside + slope * jnp.maximum(place - 1.0, 0.0)

    @property
    def heights(self) -> Float[Array, " k"]:
        """[k] metres from the axis."""
        return self.reach * self.places


def height_curve(
    heights: ArrayLike | Sequence[float],
    values: ArrayLike | Sequence[float],
    *,
    even: bool = True,
    name: str = "the table",
) -> HeightCurve:
    """A `HeightCurve` with checked values.

    Args:
        heights: [k] metres from the axis, rising from 0.
        values: [k] there; 0 on the axis if not `even`.
        even: whether the function is the same on both sides of the axis.
        name: what to call it in messages.

    Raises:
        ValueError: numbers that do not match, fewer than two, values that are no numbers within 1e9, heights
            that do not rise from 0, or a value on the axis where there can be none.

    Example:
        >>> curve = height_curve([0.0, 0.01, 0.02], [0.0, -0.01, -0.04])
        >>> round(float(curve(jnp.array(0.02))), 6)
        -0.04
    """
    places, found = checked_table(heights, values, name)
    if not even and found[0] != 0:
        raise ValueError(
            f"{name} starts with {found[0]:g} on the axis, where there is none of it; start with 0"
        )
    reach, shares = jnp.asarray(places[-1], dtype=float), jnp.asarray(places / places[-1], dtype=float)
    return HeightCurve(reach, shares, jnp.asarray(found, dtype=float), even)


def checked_table(
    heights: ArrayLike | Sequence[float], values: ArrayLike | Sequence[float], name: str
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Heights in metres and what a table has there, as arrays; refused as `height_curve` says."""
    places = real_numbers(heights, f"heights of {name}", "metres, rising from 0 on")
    found = real_numbers(values, f"values of {name}", "finite numbers, one for each height")
    if places.ndim != 1 or places.shape != found.shape or len(places) < 2:
        raise ValueError(
            f"{name} has {places.size} heights and {found.size} values; expected two or more, as many of both"
        )
    if not np.isfinite(places).all() or places[0] != 0 or not (np.diff(places) > 0).all():
        raise ValueError(f"{name} has heights {places.tolist()} m; expected rising ones from 0 on")
    if not (np.abs(found) <= _LARGEST).all():
        raise ValueError(f"{name} has values {found.tolist()}; expected numbers within {_LARGEST:g}")
    return places, found
