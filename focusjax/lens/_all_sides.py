"""Lenses that are not the same all around their axis: what their film points see, from all sides.

Pupils and bounds are kept over the distance from the axis alone. Of a lens with a height field they are
found along many radii, with their mirror images, and what holds for all of them is kept.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.lens._pupils import Pupils, Turn, find_pupils
from focusjax.lens._ray_bounds import RayBounds, find_bounds
from focusjax.optics import HeightField, Prescription

_RADII = 8
"""Directions in which film points are examined, evenly around the axis."""


def is_round(lens: Prescription) -> bool:
    """Whether all surfaces are of revolution."""
    return not any(isinstance(surface, HeightField) for surface in lens.surfaces)


@jit
def find_all_around(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    film: Float[Array, ""],
    scale: Float[Array, ""],
    pupil: Float[Array, ""],
    radii: Float[Array, " k"],
) -> tuple[Pupils, RayBounds]:
    """As `find_pupils` and `find_bounds`, for film points in every direction from the axis.

    Args:
        lens: in mm.
        indices: refractive indices.
        film: mm from the last vertex.
        scale: mm of the film per tangent.
        pupil: mm from the first vertex to the entrance pupil.
        radii: tangents of film points, in equal steps, an odd number of them.
    """
    angles = np.repeat(np.linspace(0.0, 2.0 * np.pi, _RADII, endpoint=False), 2)
    sides = np.tile([1.0, -1.0], _RADII)
    turns = Turn(*(jnp.asarray(each, radii.dtype) for each in (np.cos(angles), np.sin(angles), sides)))

    def along(turn: Turn) -> tuple[Pupils, RayBounds]:
        pupils = find_pupils(lens, indices, film, scale * radii, turn)
        return pupils, find_bounds(lens, indices, film, scale, pupil, pupils, radii, turn)

    pupils, bounds = jax.lax.map(along, turns)
    return _covering(pupils), _enclosing(bounds)


def _covering(each: Pupils) -> Pupils:
    """Ellipses around those of all directions [d, k]."""
    centre = each.centre.mean(axis=0, keepdims=True)
    wider = 1.0 + jnp.abs(each.centre - centre) / jnp.where(each.radial > 0.0, each.radial, 1.0)
    return Pupils(
        centre=centre[0],
        radial=jnp.max(each.radial * wider, axis=0),
        tangential=jnp.max(each.tangential * wider, axis=0),
        inside=each.inside[0],
        rim=each.rim[0],
        open=each.open.any(axis=0),
    )


def _enclosing(each: RayBounds) -> RayBounds:
    """Disks around those of all directions [d, k]."""
    middle = jax.tree.map(lambda leaf: leaf.mean(axis=0, keepdims=True), each)
    b_off = each.crossing - middle.crossing
    a_off = each.at_infinity - middle.at_infinity + b_off * middle.focus
    spot = each.spot + jnp.abs(a_off) + each.spread * jnp.abs(each.focus - middle.focus)
    return eqx.tree_at(
        lambda bounds: (bounds.spot, bounds.spread, bounds.beyond),
        jax.tree.map(lambda leaf: leaf[0], middle),
        (spot.max(axis=0), (each.spread + jnp.abs(b_off)).max(axis=0), each.beyond.max(axis=0)),
    )
