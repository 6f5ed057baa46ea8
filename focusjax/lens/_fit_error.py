"""Rays that polynomials for a real lens are fitted to, and how far off in pixels those by polynomials are."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._aperture import Disk
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._pupils import SOFTNESS, openness, way_from_film
from focusjax.lens._ray_bounds import STEEPEST, exit_line, is_round
from focusjax.lens._transfer import TracedRays, Transfer
from focusjax.optics import BLOCKED, trace_path

_FILM_POINTS, _RINGS, _TURNS = 16, 9, 13
_UNEVEN_RINGS, _UNEVEN_TURNS = 5, 15
"""Of film points, and of places in the opening for each, in a lens that is not the same all around."""
_BESIDE = 0.03
"""Clearance beyond a rim up to which rays count fully."""
_LITTLE = 0.03
"""How much rays farther out count."""
_RAYS = 1 << 14
_WORST = 48
"""Rays with the largest errors, of lines and of outlines each, near which worse ones are looked for."""
_NEAR = 192
"""Rays that are looked at near each of them."""
_REACHES = (0.06, 0.015, 0.004)
"""Shares of frame and opening within which they lie, one after the other."""
_PLASTIC = 1.1673039782614187
"""The root of x^5 = x + 1; multiples of its powers are spread evenly over a cube in four dimensions."""


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


class FitError(eqx.Module):
    """Errors over all of the frame and the opening.

    Attributes:
        disparities: in 1/m [2], the least and the largest for which the next are.
        worst: pixels [2] by which a ray that gets through is off at most: the largest error over frame and
            opening, their edges and corners, and ever nearer to the worst rays found.
        rms: root of the mean square [2], by the light along them.
        outline: pixels [2] by which the outline of what gets through is off at most.
        light: the share of all light that goes where it should not or is missing where it should be.
    """

    disparities: Float[Array, "2"]
    worst: Float[Array, "2"]
    rms: Float[Array, "2"]
    outline: Float[Array, "2"]
    light: Float[Array, ""]

    def largest(self) -> Float[Array, ""]:
        """Pixels: of rays and outlines, at either disparity."""
        return jnp.maximum(self.worst.max(), self.outline.max())


@jit
def fit_error(
    exact: PrescriptionLens, transfer: Transfer, camera: Camera, disparities: Float[Array, "2"]
) -> FitError:
    """The errors of `transfer` over rays that were not fitted, spread over frame and opening."""
    frame = jnp.array([camera.width, camera.height], dtype=disparities.dtype)
    spread = jnp.asarray(_spread(_RAYS), dtype=disparities.dtype)

    def one(point: Array) -> tuple[Array, ...]:
        film, pupil = point[:2] * frame, Disk().point(point[2:])
        aim = exact.aim(camera, film, pupil)
        *line, clearance = exact.passing(aim)
        slope, crossing = (jnp.stack(pair) for pair in line)

        def fitted(pupil: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
            aim = exact.aim(camera, film, pupil)
            (x, y), crossing, clear = transfer(aim.tangents, aim.target)
            slope = jnp.stack([x - aim.tangents[0], y - aim.tangents[1]])
            found = landed(slope, jnp.stack(crossing)), clear
            return found, found

        def landed(slope: Array, crossing: Array) -> Array:
            return camera.focal_px * (slope[None] + 1e-3 * disparities[:, None] * crossing[None])

        (moves, gradient), (places, clear) = jax.jacfwd(fitted, has_aux=True)(pupil)
        flat = slope @ slope < STEEPEST**2
        light, claimed = (jnp.where(flat, openness(c) * aim.light, 0.0) for c in (clearance, clear))
        square = gradient @ gradient
        rim = (jnp.abs(clearance) < SOFTNESS / 2) & (square > 0.0) & (aim.light > 0.0) & flat
        # The outline moves along the gradient of the clearance, and what is seen of it as the opening does.
        off = (clear - clearance) / jnp.where(rim, square, 1.0)
        outline = jnp.where(rim, jnp.linalg.norm(moves @ (gradient * off), axis=-1), 0.0)
        errors = jnp.linalg.norm(places - landed(slope, crossing), axis=-1)
        return jnp.where(light > 0.0, errors, 0.0), outline, light, jnp.abs(light - claimed)

    def worst_of(points: Array, found: Array) -> tuple[Array, Array]:
        """The points with the largest errors of lines and outlines [n, 4], and the largest of all."""
        return points[jax.lax.top_k(found.T, _WORST)[1].reshape(-1)], found.max(axis=0)

    def worse(chosen: Array, reach: Array) -> tuple[Array, Array]:
        """As `worst_of`, of points near those that are chosen, these among them."""
        steps = reach * (2.0 * spread[:_NEAR] - 1.0).at[0].set(0.0)
        near = jnp.clip(chosen[:, None] + steps[None], 0.0, 1.0).reshape(-1, 4)
        errors, outline, _, _ = jax.vmap(one)(near)
        return worst_of(near, jnp.concatenate([errors, outline], axis=1))

    # Polynomials are farthest off at the ends of what they are for: half of all numbers are 0 or 1 here.
    points = jnp.concatenate([spread, jnp.clip(2.0 * spread - 0.5, 0.0, 1.0)])
    errors, outline, light, wrong = jax.vmap(one)(points)
    chosen, first = worst_of(points, jnp.concatenate([errors, outline], axis=1))
    # In a loop, so that rays through the glass are compiled once for all rounds.
    _, rounds = jax.lax.scan(worse, chosen, jnp.asarray(_REACHES, dtype=disparities.dtype))
    largest = jnp.maximum(first, rounds.max(axis=0))
    errors, light, wrong = (values[:_RAYS] for values in (errors, light, wrong))
    total = light.sum()
    return FitError(
        disparities=disparities,
        worst=largest[:2],
        rms=jnp.sqrt(light @ errors**2 / total),
        outline=largest[2:],
        light=wrong.sum() / total,
    )


def _spread(count: int) -> Float[np.ndarray, "n 4"]:
    """Points of the unit cube in four dimensions (Roberts 2018)."""
    steps = _PLASTIC ** -np.arange(1.0, 5.0)
    return (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
