"""Where the film of a real lens has to be."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._pupils import openness
from focusjax.lens._ray_bounds import is_round
from focusjax.optics import Prescription, film_distance, first_order, line, trace

RINGS = 1024
"""Of equal area, over which spots and light on the axis are averaged."""
GOLDEN_ANGLE = 2.399963229728653


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
    if not is_round(prescription):
        return _best_film_all_around(prescription, indices, disparity)
    seen = first_order(prescription)
    heights = seen.entrance_pupil_radius * jnp.sqrt((jnp.arange(RINGS, dtype=indices.dtype) + 0.5) / RINGS)

    def land(height: Array) -> tuple[Array, Array, Array]:
        slope = height * disparity
        way = jnp.stack([slope, jnp.zeros_like(slope), jnp.ones_like(slope)])
        start = jnp.stack([height, jnp.zeros_like(height), seen.entrance_pupil])
        found = trace(prescription, indices, start, way / jnp.sqrt(way @ way))
        exit_slope = found.direction[0] / found.direction[2]
        place = found.position[0] + exit_slope * (prescription.vertices()[-1] - found.position[2])
        return place, exit_slope, openness(found.clearance)

    place, slope, weight = jax.vmap(land)(heights)
    return -jnp.sum(weight * place * slope) / jnp.sum(weight * slope**2)


def _best_film_all_around(
    prescription: Prescription, indices: Float[Array, " n_plus_1"], disparity: Float[Array, ""]
) -> Float[Array, ""]:
    """As `best_film`, by rays over the whole opening."""
    seen = first_order(prescription)
    number = jnp.arange(RINGS, dtype=indices.dtype)
    heights = seen.entrance_pupil_radius * jnp.sqrt((number + 0.5) / RINGS)
    angles = GOLDEN_ANGLE * number
    places = jnp.stack([heights * jnp.cos(angles), heights * jnp.sin(angles)], axis=1)

    def land(place: Array) -> tuple[Array, Array, Array]:
        way = jnp.append(place * disparity, 1.0)
        start = jnp.append(place, seen.entrance_pupil)
        found = trace(prescription, indices, start, way / jnp.sqrt(way @ way))
        slope = found.direction[:2] / found.direction[2]
        gap = prescription.vertices()[-1] - found.position[2]
        return found.position[:2] + slope * gap, slope, openness(found.clearance)

    place, slope, weight = jax.vmap(land)(places)
    share = weight[:, None] / jnp.sum(weight)
    # A wedge moves the whole spot, which is no blur.
    place, slope = (values - jnp.sum(share * values, axis=0, keepdims=True) for values in (place, slope))
    return -jnp.sum(share * place * slope) / jnp.sum(share * slope**2)
