"""Where the film of a real lens has to be."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._pupils import openness
from focusjax.lens._ray_bounds import is_round
from focusjax.optics import Prescription, film_distance, first_order, line, trace

_RINGS = 1024
"""Of equal area, over which spots and light on the axis are averaged."""
_GOLDEN_ANGLE = 2.399963229728653


def film_for(
    prescription: Prescription,
    camera: Camera,
    focus_disparity: Float[Array, ""],
    focus: str,
    *,
    breathing: bool,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Distance in mm from the last vertex to the film, and the film's scale s; see `focused_lens`."""
    seen = first_order(prescription)
    indices = prescription.indices(line())
    disparity = focus_disparity * 1e-3
    film, scale = film_distance(prescription, indices, disparity)
    if focus == "traced":
        best = best_film(prescription, indices, disparity)
        scale = scale * (best - seen.exit_pupil) / (film - seen.exit_pupil)
        film = best
    if breathing:
        scale = camera.focal_length * 1e3
    return film, scale


@jit
def best_film(
    prescription: Prescription, indices: Float[Array, " n_plus_1"], disparity: Float[Array, ""]
) -> Float[Array, ""]:
    """Distance in mm from the last vertex at which the rays of the point in focus on the axis are closest.

    In the meridional plane the spot's variance over rings of equal area is a parabola in the film's distance.
    Of a lens that is not the same all around its axis, each ring is looked at in another direction.
    """
    seen = first_order(prescription)

    def land(place: Array) -> tuple[Array, Array, Array]:
        way = jnp.append(place * disparity, 1.0)
        start = jnp.append(place, seen.entrance_pupil)
        found = trace(prescription, indices, start, way / jnp.sqrt(way @ way))
        slope = found.direction[:2] / found.direction[2]
        gap = prescription.vertices()[-1] - found.position[2]
        return found.position[:2] + slope * gap, slope, openness(found.clearance)

    place, slope, weight = jax.vmap(land)(seen.entrance_pupil_radius * rings(prescription, indices.dtype))
    share = weight[:, None] / jnp.sum(weight)
    if not is_round(prescription):
        # A wedge moves the whole spot, which is no blur.
        place, slope = (values - jnp.sum(share * values, axis=0, keepdims=True) for values in (place, slope))
    return -jnp.sum(share * place * slope) / jnp.sum(share * slope**2)


def rings(prescription: Prescription, dtype: jnp.dtype) -> Float[Array, "r 2"]:
    """A point of each of many rings of equal area of the unit disk.

    Of a lens that is the same all around, points are along x, and each stands for its ring; else each is
    turned on from the last.
    """
    number = jnp.arange(_RINGS, dtype=dtype)
    radii, angles = jnp.sqrt((number + 0.5) / _RINGS), _GOLDEN_ANGLE * number
    if is_round(prescription):
        angles = jnp.zeros_like(number)
    return jnp.stack([radii * jnp.cos(angles), radii * jnp.sin(angles)], axis=1)
