"""How deep the rays of a pixel need to look: the disparities found under their footprint."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.layers import Layers
from focusjax.lens import AbstractLens

_ROUNDS = 4


def disparity_range(
    layers: Layers, lens: AbstractLens, film_point: Float[Array, "2"]
) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
    """Least and largest disparity that rays of the pixel around `film_point` can meet, and layer count.

    Lee10 section 3.1: bound the footprint for the whole scene, look up the disparities under it, bound
    again for those alone, and so on; a few rounds gain nearly all. The largest is 0 where there is
    nothing to meet.
    """
    grid = layers.grid
    # Half a pixel of filter, and half a sample because rays are rounded to their nearest sample.
    slack = 0.5 * grid.supersampling + 1.0

    def narrow(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        least, largest, _depth = state
        corners = []
        for disparity in (least, largest):
            centre, radius = lens.footprint(layers.camera, film_point, disparity)
            on_grid = centre * grid.supersampling + grid.margin
            reach = radius * grid.supersampling + slack
            corners.append((on_grid - reach, on_grid + reach))
        low = jnp.minimum(corners[0][0], corners[1][0])
        high = jnp.maximum(corners[0][1], corners[1][1])
        found_least, found_largest, depth = layers.ranges.query(low, high)
        # Where nothing is below, the range is empty: collapse it to infinity.
        empty = found_largest <= 0
        return jnp.where(empty, 0.0, found_least), jnp.where(empty, 0.0, found_largest), depth

    overall = layers.ranges.overall
    start = (jnp.where(overall[1] > 0, overall[0], 0.0), overall[1], layers.ranges.most_layers)
    return jax.lax.fori_loop(0, _ROUNDS, narrow, start)
