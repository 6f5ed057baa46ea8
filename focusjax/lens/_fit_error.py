"""How far rays by polynomials are from those through the glass, in pixels."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._aperture import Disk
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._pupils import SOFTNESS, openness
from focusjax.lens._ray_bounds import STEEPEST
from focusjax.lens._transfer import Transfer

_RAYS = 1 << 14
_WORST = 48
"""Rays with the largest errors, of lines and of outlines each, near which worse ones are looked for."""
_NEAR = 192
"""Rays that are looked at near each of them."""
_REACHES = (0.06, 0.015, 0.004)
"""Shares of frame and opening within which they lie, one after the other."""
_PLASTIC = 1.1673039782614187
"""The root of x^5 = x + 1; multiples of its powers are spread evenly over a cube in four dimensions."""


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
