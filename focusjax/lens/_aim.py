"""Where rays of a real lens start, and what they are in the picture."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._length import Pair, root
from focusjax.lens._pupils import openness
from focusjax.lens._ray_bounds import STEEPEST


class Aim(eqx.Module):
    """How a ray starts at the film of a real lens, upside down and y upwards as the lens sees it.

    Attributes:
        tangents: the film point, over s.
        target: point of the last vertex plane in mm that the ray is aimed at.
        light: weight of the ray if it passes; 0 beyond the film.
    """

    tangents: Pair
    target: Pair
    light: Float[Array, ""]


def line_of(
    camera: Camera,
    film_point: Float[Array, "2"],
    light: Float[Array, ""],
    slope: Pair,
    crossing: Pair,
    clearance: Float[Array, ""],
) -> LensRay:
    """A ray ahead of a real lens as a line in image space; cut off, it is the pinhole's, without light.

    `light` is its weight if it passes.
    """
    flat = slope[0] * slope[0] + slope[1] * slope[1] < STEEPEST**2
    share = jnp.where(flat, openness(clearance) * light, 0.0)
    a, b = [], []
    for axis, sign in enumerate((1.0, -1.0)):
        ahead = camera.principal_point[axis] + sign * camera.focal_px * slope[axis]
        a.append(jnp.where(share > 0.0, ahead, film_point[axis]))
        b.append(jnp.where(share > 0.0, sign * 1e-3 * camera.focal_px * crossing[axis], 0.0))
    return LensRay(a=jnp.stack(a), b=jnp.stack(b), weight=share)


def polar(x: Float[Array, ""], y: Float[Array, ""]) -> tuple[Float[Array, ""], Pair]:
    """Length and direction; of the zero vector 0 and x, with derivative 0."""
    size = root(x * x + y * y)
    inverse = 1.0 / jnp.where(size > 0.0, size, 1.0)
    return size, (jnp.where(size > 0.0, x * inverse, 1.0), y * inverse)
