"""How deep the rays of a pixel need to look: the disparities found under their footprint."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.geometry import filter_radius
from focusjax.layers import Layers
from focusjax.lens import AbstractLens

_ROUNDS = 4


def disparity_range(
    layers: Layers, lens: AbstractLens, film_point: Float[Array, "2"], pixel_filter: str = "box"
) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
    """Least and largest disparity that rays of the pixel around `film_point` can meet, and layer count.

    Lee10 section 3.1: bound the footprint for the whole scene, look up the disparities under it, bound
    again for those alone, and so on; a few rounds gain nearly all. The largest is 0 where there is
    nothing to meet.
    """
    grid = layers.grid
    # Rays start anywhere in the pixel or as far beyond as the filter reaches, for which the corners of all
    # pixels there answer. They are rounded to their nearest sample.
    wide = filter_radius(pixel_filter)
    ends = sorted({-wide, -0.5, 0.5, wide})
    offsets = jnp.array([(x, y) for y in ends for x in ends], dtype=film_point.dtype)
    slack = 1.0

    def bound(film: Float[Array, "2"], disparity: Float[Array, ""]) -> tuple[Array, Array]:
        """The square on the grid around the footprint of one film point."""
        centre, radius = lens.footprint(layers.camera, film, disparity)
        on_grid, reach = centre * grid.supersampling + grid.margin, radius * grid.supersampling
        return on_grid - reach, on_grid + reach

    def narrow(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        least, largest, _depth = state
        ends = jnp.stack([least, largest])
        bounds = jax.vmap(lambda w: jax.vmap(lambda step: bound(film_point + step, w))(offsets))(ends)
        low, high = bounds[0].min(axis=(0, 1)) - slack, bounds[1].max(axis=(0, 1)) + slack
        found_least, found_largest, depth = layers.ranges.query(low, high)
        # Where nothing is below, the range is empty: collapse it to infinity.
        empty = found_largest <= 0
        return jnp.where(empty, 0.0, found_least), jnp.where(empty, 0.0, found_largest), depth

    overall = layers.ranges.overall
    start = (jnp.where(overall[1] > 0, overall[0], 0.0), overall[1], layers.ranges.most_layers)
    return jax.lax.fori_loop(0, _ROUNDS, narrow, start)
