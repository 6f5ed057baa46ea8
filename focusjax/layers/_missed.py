"""Missed light: the share of lens rays whose nearest surface the layers do not hold.

Ray i, of weight W_i, meets its first surface at disparity w_i, which is seen at q(w_i) = a_i + b_i w_i. The
layers hold that point if some sample under q(w_i), or among the eight around it, stands for disparities
[low, high] with low - t <= w_i <= high + t. The missed light is

    M = sum over i of W_i [not held]  /  sum over i of W_i.

The samples around count, since a silhouette is within a sample of where the samples put it. The tolerance is
t = 1 / (f E), f E in samples per dioptre: two surfaces that are closer move apart by less than a sample
even for rays through the lens rim, on which peeling with the umbra and joins between samples rest too.
Both make M too small, by what a border one sample wide at occlusions holds.

Surfaces that no sample's centre shows, such as leaves smaller than a sample, are missed by any layers on
the same grid. Compare with the layers of plain peeling, which miss them too, to find what else is missed.
"""

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax._arguments import require_kind
from focusjax._counts import require_counts, require_seed
from focusjax._programs import jit
from focusjax._words import kind_of
from focusjax.geometry import Camera, LensRay
from focusjax.layers._cells import interval
from focusjax.layers._layers import Layers
from focusjax.lens import AbstractLens

_AT_ONCE = 1 << 16

NearestSurface = Callable[[LensRay], Float[np.ndarray, " n"]]
"""From n lens rays to the disparity [n] where each first meets a surface, 0 where it meets none."""


@dataclasses.dataclass(frozen=True)
class MissedLight:
    """An estimate of M.

    Attributes:
        share: 0 to 1.
        standard_error: of the share. Not 0 even if no ray missed: it is that of M = (k + 1) / (n + 2), k of n
            rays having missed (Laplace's rule of succession).
        rays: how many were cast.
    """

    share: float
    standard_error: float
    rays: int


def missed_light(
    layers: Layers,
    nearest: NearestSurface,
    *,
    lens: AbstractLens | None = None,
    rays: int = 1 << 17,
    seed: int = 0,
) -> MissedLight:
    """The share of lens rays whose nearest surface is not in `layers`, estimated from random rays.

    Rays start at independent uniform places of the frame and of the opening, so that the variance of the
    estimate is that of independent draws,

        standard error = sqrt(M (1 - M) / n),    n = (sum of W)^2 / sum of W^2.

    Only the nearest surface of a ray counts, and what may be seen through is a surface like any other:
    layers behind glass are not examined.

    Args:
        layers: what is examined.
        nearest: the truth: `focusjax.baselines.nearest_in_scene` casts rays at the scene itself, and
            `focusjax.trace.nearest_in_layers` traces them through other layers, such as all there are.
        lens: whose rays; the lens that the layers were made for if not given.
        rays: how many in all.
        seed: chooses the rays.

    Raises:
        ValueError: no rays, or a truth that is no function.

    Example:
        >>> from focusjax import look_at, make_scene, nearest_in_layers, peel, thin_lens
        >>> from focusjax.scene import make_object
        >>> post = make_object("post", [(-0.1, -9, -1), (0.1, -9, -1), (0, 9, -1)], [(0, 1, 2)])
        >>> wall = make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = look_at((0, 0, 0), (0, 0, -1), width=32, height=24, field_of_view=0.7)
        >>> view = make_scene([post, wall]), camera, thin_lens(focus_distance=2.0, aperture_radius=0.2)
        >>> everything = nearest_in_layers(peel(*view, umbra=False))
        >>> missed_light(peel(*view), everything).share < 1e-3
        True
        >>> missed_light(peel(*view, max_layers=1), everything).share > 0.02
        True
    """
    usage = "missed_light(layers, nearest)"
    require_kind(layers, Layers, usage, "`peel` and `decompose` make them", "layers")
    require_counts(rays=rays)
    seed = require_seed(seed)
    if not callable(nearest):
        raise ValueError(
            f"nearest of {usage} is {kind_of(nearest)}; expected a function from lens rays to the disparities"
            " that they meet, such as nearest_in_layers(layers) of other layers, or nearest_in_scene(scene)"
        )
    if lens is not None:
        require_kind(lens, AbstractLens, usage, "the lens whose rays are cast", "lens")
    lens = layers.lens if lens is None else lens
    random = np.random.default_rng(seed)
    missed, weights = [], []
    for start in range(0, rays, _AT_ONCE):
        count = min(_AT_ONCE, rays - start)
        starts = jnp.asarray(random.uniform(size=(count, 4)), dtype=layers.background.dtype)
        some = _lens_rays(lens, layers.camera, starts)
        disparity = nearest(some)
        held = _held(layers, some, jnp.asarray(disparity, dtype=starts.dtype))
        missed.append((disparity > 0) & ~np.asarray(held))
        weights.append(np.asarray(some.weight, dtype=np.float64))
    weight = np.concatenate(weights)
    share = float(np.average(np.concatenate(missed), weights=weight))
    draws = float(weight.sum() ** 2 / (weight**2).sum())
    smoothed = (share * draws + 1.0) / (draws + 2.0)
    return MissedLight(share, math.sqrt(smoothed * (1.0 - smoothed) / draws), rays)


@jit
def _lens_rays(lens: AbstractLens, camera: Camera, starts: Float[Array, "n 4"]) -> LensRay:
    """Rays from places of the frame and the opening given as points of the unit 4-cube."""

    def one(start: Float[Array, "4"]) -> LensRay:
        film = start[:2] * jnp.array([camera.width, camera.height], dtype=start.dtype)
        return lens.ray(camera, film, lens.pupil_point(start[2:]))

    return jax.vmap(one)(starts)


@jit
def _held(layers: Layers, rays: LensRay, disparity: Float[Array, " n"]) -> Bool[Array, " n"]:
    """Whether the layers hold the surface that each ray meets at `disparity`."""
    grid = layers.grid
    moves = layers.lens.parallax(layers.camera) * grid.supersampling
    tolerance = 1.0 / jnp.maximum(moves, 1e-30)
    cells = layers.cells.reshape(layers.count, -1)
    around = jnp.array([(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1)])

    def one(place: Float[Array, "2"], w: Float[Array, ""]) -> Bool[Array, ""]:
        column, row = (jnp.floor(place).astype(jnp.int32)[None] + around).T
        inside = (column >= 0) & (column < grid.columns) & (row >= 0) & (row < grid.rows)
        words = cells.at[:, jnp.where(inside, row * grid.columns + column, 0)].get(mode="promise_in_bounds")
        low, high = (steps * layers.disparity_scale for steps in interval(words))
        return jnp.any(inside[None] & (words > 0) & (low - tolerance <= w) & (w <= high + tolerance))

    return jax.vmap(one)(rays.at(disparity) * grid.supersampling + grid.margin, disparity)
