"""By how many pixels the blur of one lens differs from another's."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.exchange._opening import opening_points
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

_COLUMNS, _ROWS, _DEPTHS = 9, 7, 5
_DIRECTIONS = 64


def blur_error(
    lens: AbstractLens, other: AbstractLens, camera: Camera, disparities: tuple[float, float]
) -> float:
    """The largest difference in pixels between the spots that two lenses make of a point.

    Spots are compared in 63 places of the frame and at five disparities, by how far they extend in each
    direction from their film point, twice, as by their diameters; and by the diameters of uniform disks whose
    light has the same variance.

    Args:
        lens: what the picture is made with.
        other: what is to stand in for it.
        camera: whose frame counts.
        disparities: least and largest in 1/m of what is seen.
    """
    grid = np.stack(
        np.meshgrid(np.linspace(0, camera.width, _COLUMNS), np.linspace(0, camera.height, _ROWS)), axis=-1
    ).reshape(-1, 2)
    film = jnp.asarray(grid, dtype=float)
    depths = jnp.asarray(np.linspace(*disparities, _DEPTHS), dtype=float)
    worst = 0.0
    for one, two in _of_colours(lens, other):
        extents, diameters = _spots(one, camera, film, depths)
        extents_too, diameters_too = _spots(two, camera, film, depths)
        beside = 2.0 * float(jnp.abs(extents - extents_too).max())
        worst = max(worst, beside, float(jnp.abs(diameters - diameters_too).max()))
    return worst


def _of_colours(lens: AbstractLens, other: AbstractLens) -> Sequence[tuple[AbstractLens, AbstractLens]]:
    """The lenses of each colour beside each other."""
    return [(channel.lens, other) for channel in lens.channels()] or [(lens, other)]


@jit
def _spots(
    lens: AbstractLens, camera: Camera, film: Float[Array, "n 2"], depths: Float[Array, " d"]
) -> tuple[Float[Array, "n d k"], Float[Array, "n d"]]:
    """How far spots extend in each direction, and the diameters of disks of their variance, in pixels."""
    opening = lens.opening()
    rim = jax.vmap(opening.rim)((jnp.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS)
    inside = opening_points(opening)
    turns = 2.0 * jnp.pi * jnp.arange(_DIRECTIONS) / _DIRECTIONS
    towards = jnp.stack([jnp.cos(turns), jnp.sin(turns)])

    def at(point: Array, disparity: Array) -> tuple[Array, Array]:
        def lands(pupil: Array) -> tuple[Array, Array]:
            ray = lens.ray(camera, point, pupil)
            return ray.a + ray.b * disparity - point, ray.weight

        edge, at_edge = jax.vmap(lands)(rim)
        places, weights = jax.vmap(lands)(inside)
        # Rims of glass may take the edge's light.
        there, lit = jnp.concatenate([edge, places]), jnp.concatenate([at_edge, weights]) > 0
        extent = jnp.max(jnp.where(lit[:, None], there @ towards, -jnp.inf), axis=0)
        extent = jnp.where(lit.any(), extent, 0.0)
        share = weights / jnp.maximum(weights.sum(), 1e-12)
        away = places - (share @ places)[None]
        # A uniform disk of diameter D has a variance of D^2 / 8.
        return extent, jnp.sqrt(8.0 * (share @ (away**2).sum(axis=1)))

    across = jax.vmap(at, in_axes=(None, 0))
    return jax.vmap(across, in_axes=(0, None))(film, depths)
