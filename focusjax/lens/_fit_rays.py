"""Rays through a real lens that polynomials are fitted to."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._pupils import SOFTNESS, way_from_film
from focusjax.lens._ray_bounds import STEEPEST, exit_line, is_round
from focusjax.lens._transfer import TracedRays
from focusjax.optics import BLOCKED, trace_path

_FILM_POINTS, _RINGS, _TURNS = 16, 9, 13
_UNEVEN_RINGS, _UNEVEN_TURNS = 5, 15
"""Of film points, and of places in the opening for each, in a lens that is not the same all around."""
_BESIDE = 0.03
"""Clearance beyond a rim up to which rays count fully."""
_LITTLE = 0.03
"""How much rays farther out count."""


def _mirrored() -> tuple[Float[np.ndarray, "r 2"], Float[np.ndarray, "r 2"]]:
    """Film points along the x axis, half of the opening for each: what a round lens does all around.

    Film points are in shares of the farthest, places in the opening in its radii.
    """
    radii = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, _FILM_POINTS))
    rings = np.append(np.sin(0.5 * np.pi * (np.arange(_RINGS - 1) + 0.5) / (_RINGS - 1)), 1.0)
    turns = np.linspace(0.0, np.pi, _TURNS)
    film, rings, turns = (each.ravel() for each in np.meshgrid(radii, rings, turns, indexing="ij"))
    pupil = np.stack([rings * np.cos(turns), rings * np.sin(turns)], axis=1)
    return np.stack([film, np.zeros_like(film)], axis=1), pupil


def _all_around() -> tuple[Float[np.ndarray, "r 2"], Float[np.ndarray, "r 2"]]:
    """As `_mirrored`, film points all over a disk and all of the opening for each."""
    radii = np.sin(0.5 * np.pi * (np.arange(_UNEVEN_RINGS) + 1.0) / _UNEVEN_RINGS)
    turns = 2.0 * np.pi * np.arange(_UNEVEN_TURNS) / _UNEVEN_TURNS
    # Every other ring turned by half a step.
    angles = turns[None] + np.pi / _UNEVEN_TURNS * (np.arange(_UNEVEN_RINGS)[:, None] % 2)
    disk = np.stack([radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles)], axis=2).reshape(-1, 2)
    return np.repeat(disk, len(disk), axis=0), np.tile(disk, (len(disk), 1))


def traced_rays(lens: PrescriptionLens, camera: Camera) -> TracedRays:
    """Rays through the glass over film and opening, and the squares at all surfaces."""
    dtype = lens.indices.dtype
    films, pupils = (
        jnp.asarray(each, dtype=dtype)
        for each in (_mirrored() if is_round(lens.prescription) else _all_around())
    )
    farthest = (lens.pupils.centre.shape[0] - 1) * lens.film_step

    def one(film: Array, pupil: Array) -> TracedRays:
        # Seen from the lens, the film is upside down.
        tangents = farthest * film * jnp.array([1.0, -1.0], dtype=dtype)
        aim = lens.aim(camera, camera.principal_point - camera.focal_px * tangents, pupil)
        x, y = aim.tangents
        start, way = way_from_film(
            lens.prescription, lens.film_place, (lens.film_scale * x, lens.film_scale * y), aim.target
        )
        found, points = trace_path(lens.prescription, lens.indices, start, way, backward=True)
        line = exit_line(found.position, found.direction, lens.entrance_pupil)
        slope, crossing = (jnp.stack(pair) for pair in line)
        squares = (points[:, 0] ** 2 + points[:, 1] ** 2) / lens.prescription.semi_diameters**2
        there = (found.clearance > 0.5 * BLOCKED) & (slope @ slope < STEEPEST**2)
        near = jnp.where(found.clearance > -_BESIDE, 1.0, _LITTLE)
        rim = jnp.where(squares.max() < 1.5, 1.0, _LITTLE)
        weights = [jnp.where(there, weight, 0.0) for weight in (near, rim)]
        beyond = slope + jnp.stack([x, y])
        return TracedRays(aim.tangents, aim.target, beyond, crossing, squares, *weights)

    return jax.vmap(one)(films, pupils)


def limiting_rims(rays: TracedRays) -> tuple[int, ...]:
    """Numbers of the surfaces whose rims cut any ray off, or nearly so."""
    squares, counts = np.asarray(rays.squares), np.asarray(rays.rim_weight) > 0
    largest = squares.max(axis=1, keepdims=True)
    first = (squares == largest) & (largest > (1.0 - 2.0 * SOFTNESS) ** 2) & counts[:, None]
    return tuple(int(number) for number in np.flatnonzero(first.any(axis=0)))
