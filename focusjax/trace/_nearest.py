"""Which surface of some layers lens rays meet first."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._programs import jit
from focusjax.geometry import LensRay
from focusjax.layers import Layers, interval
from focusjax.trace._radiances import on_grid
from focusjax.trace._walk import first_hit, make_volume

_SAMPLES_BEYOND = 0.5
"""Half the width of a sample."""


def nearest_in_layers(layers: Layers) -> Callable[[LensRay], Float[np.ndarray, " n"]]:
    """Which surface of `layers` lens rays meet first, by the tracer's walk: a truth for `missed_light`.

    It is as good as the layers are: give it those of `peel(..., umbra=False)` with layers to spare.

    Returns:
        a function from n rays to the disparities [n] in 1/m where they first meet a surface, 0 where none.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens, umbra=False)
        >>> on_axis = lens.ray(camera, jnp.array([4.5, 2.5]), jnp.zeros(2))
        >>> nearest = fj.nearest_in_layers(layers)
        >>> rays = jax.tree.map(lambda value: value[None], on_axis)
        >>> nearest(rays).round(3).tolist()
        [0.5]
    """

    def first_disparity(rays: LensRay) -> Float[np.ndarray, " n"]:
        return np.asarray(_first_disparities(layers, rays))

    return first_disparity


@jit
def _first_disparities(layers: Layers, rays: LensRay) -> Float[Array, " n"]:
    grid = layers.grid
    # What may be seen through is a surface, too.
    volume, cells = make_volume(layers.cells, layers.disparity_scale, None), layers.cells.reshape(-1)
    least, largest = jnp.where(layers.ranges.overall[1] > 0, layers.ranges.overall, 0.0)

    def one(ray: LensRay) -> Float[Array, ""]:
        ray = on_grid(ray, grid)
        hit = first_hit(volume, ray, least, largest)
        sample = jnp.maximum(hit, 0)
        # From the sample's centre to where the ray is above its square, as far as the surface goes there.
        low, high = _above_square(ray, sample % grid.size, grid.columns)
        end, start = (steps * layers.disparity_scale for steps in interval(cells[sample]))
        disparity = jnp.clip(
            jnp.clip(layers.samples.disparity[layers.places.number(sample)], low, high), end, start
        )
        return jnp.where(hit >= 0, disparity, 0.0)

    return jax.vmap(one)(rays)


def _above_square(
    ray: LensRay, sample: Int[Array, ""], columns: int
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Disparities between which `ray`, in grid units, is above the square of a sample."""
    centre = jnp.stack([sample % columns, sample // columns]).astype(ray.a.dtype) + 0.5
    moves = jnp.abs(ray.b) > 1e-12
    slope = jnp.where(moves, ray.b, 1.0)
    ends = jnp.stack([(centre + side * _SAMPLES_BEYOND - ray.a) / slope for side in (-1.0, 1.0)])
    low = jnp.where(moves, ends.min(axis=0), -jnp.inf).max()
    return low, jnp.where(moves, ends.max(axis=0), jnp.inf).min()
