"""How radiance changes across the square of each sample, from the samples around it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.layers._joins import NEIGHBOURS, SAME_LAYER, UNJOINED
from focusjax.layers._layers import Layers

_OPPOSITE = ((0, 1), (2, 3))
"""Right and left, below and above among the neighbours."""


@eqx.filter_jit
def radiance_slopes(layers: Layers) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Change of the radiance of `layers.samples` per sample to the right, and downwards.

    A sample's radiance is the mean over its square. With half the step between its two neighbours,

        L(dx, dy) = L + dx (L_right - L_left) / 2 + dy (L_below - L_above) / 2,    |dx|, |dy| <= 1/2,

    has the same mean and is wrong to second order only (van Leer 1979), so that what is seen out of focus
    keeps its place and its width, and a pixel in focus is the mean over its area. Where a neighbour does not
    continue the surface there is no change in that direction. Slopes are lowered where L(dx, dy) would be
    negative in a corner, in each colour by itself.

    Differentiable in the radiance; its zeros follow the last sample.
    """
    radiance, columns = layers.samples.radiance, layers.grid.columns
    size = columns * layers.grid.rows
    links, index = layers.samples.links, layers.samples.index

    def neighbour(number: int) -> tuple[Bool[Array, " n"], Int[Array, " n"]]:
        dx, dy = NEIGHBOURS[number]
        code = ((links >> (4 * number)) & 15).astype(jnp.int32)
        there = index + jnp.where(code == UNJOINED, 0, (code - SAME_LAYER) * size + dy * columns + dx)
        return code != UNJOINED, layers.places.number(there)

    sides = [(neighbour(after), neighbour(before)) for after, before in _OPPOSITE]

    def of_channel(own: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        x, y = (
            jnp.where(joined & joined_too, 0.5 * (own[after] - own[before]), 0.0)
            for (joined, after), (joined_too, before) in sides
        )
        most = 2.0 * jnp.maximum(own, 0.0)
        total = jnp.abs(x) + jnp.abs(y)
        share = jnp.where(total > most, most / jnp.where(total > most, total, 1.0), 1.0)
        return x * share, y * share

    # Colour by colour, as planes.
    across, down = zip(*(of_channel(radiance[:, channel]) for channel in range(3)), strict=True)
    return jnp.stack(across, axis=-1), jnp.stack(down, axis=-1)
