"""Focusing by a group of elements that moves between the others, the film where it is."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.optics._paraxial import film_distance
from focusjax.optics._prescription import Prescription, check_surfaces, line

_NEWTON_STEPS = 20
_MET = 1e-6
"""Millimetres."""


def shifted_group(lens: Prescription, first: int, last: int, by: float | Float[Array, ""]) -> Prescription:
    """The lens with its surfaces `first` to `last` moved by so many mm towards the film, all others in place.

    Unchecked, for compiled code; a front group leaves the rest where it is, and the first vertex moves.
    """
    steps = np.zeros(len(lens.surfaces))
    if first > 0:
        steps[first - 1] = 1.0
    steps[last] = -1.0
    return dataclasses.replace(
        lens, thicknesses=lens.thicknesses + by * jnp.asarray(steps, lens.thicknesses.dtype)
    )


def focused_by_group(lens: Prescription, first: int, last: int, disparity: float) -> Prescription:
    """The lens with a group moved so that a plane is sharp on the film that stands for far things.

    By first-order optics, at the line d. Real lenses focus so because it takes less moving than of the whole.

    Args:
        lens: in mm.
        first: number of the group's first surface, from 0.
        last: number of its last.
        disparity: 1/mm, inverse distance of the plane in focus from the entrance pupil; 0 is infinity.

    Raises:
        ValueError: no such group, all of the lens, a group that would have to move into its neighbours, or
            one that cannot focus so near.

    Example:
        >>> from focusjax.optics import lens_preset
        >>> triplet = lens_preset("cooke_triplet_50mm_f4")
        >>> nearer = focused_by_group(triplet, 0, 1, 1 / 1000)
        >>> bool(nearer.thicknesses[1] > triplet.thicknesses[1])
        True
    """
    count = len(lens.surfaces)
    if not 0 <= first <= last < count or last - first == count - 1:
        raise ValueError(
            f"the group of {lens.name} is surfaces {first} to {last}; expected some of 0 to {count - 1}, not"
            " all of them"
        )
    zero, wanted = (jnp.asarray(value, lens.thicknesses.dtype) for value in (0.0, disparity))
    place, _ = _film_and_slope(lens, first, last, zero, zero)
    by = zero
    for _ in range(_NEWTON_STEPS):
        film, slope = _film_and_slope(lens, first, last, by, wanted)
        by = by - (film - place) / slope
    moved = shifted_group(lens, first, last, by)
    refused = f"surfaces {first} to {last} of {lens.name} would have to move by {float(by):.3g} mm to focus"
    film, _ = _film_and_slope(lens, first, last, by, wanted)
    if not abs(float(film - place)) < _MET * float(jnp.sum(lens.thicknesses) + place):
        raise ValueError(f"{refused}, which does not do; focus farther away or move another group")
    if float(moved.thicknesses[:-1].min()) < 0.0:
        raise ValueError(f"{refused}, into their neighbours; focus farther away or move another group")
    try:
        check_surfaces(moved)
    except ValueError as error:
        raise ValueError(f"{refused}: {error}") from error
    return moved


@jit
def _film_and_slope(
    lens: Prescription, first: int, last: int, by: Float[Array, ""], disparity: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Where the film has to be, in mm from what stays, with the group moved by so many mm; and its slope."""
    indices = lens.indices(line())

    def film(by: Array) -> Array:
        moved = shifted_group(lens, first, last, by)
        behind = film_distance(moved, indices, disparity)[0]
        # From what stays: the first vertex, or the last behind a front group.
        return behind + moved.vertices()[-1] if first > 0 else behind

    return jax.value_and_grad(film)(by)
