"""The sharp picture, everything in focus, which needs no rays at all."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.layers import Layers, covered
from focusjax.trace._gloss import radiance_from_centre

_PLACES = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
"""Offsets (dx, dy) in samples at which each sample is looked at, all in different rows and columns."""


def render_pinhole(layers: Layers) -> Float[Array, "h w 3"]:
    """The picture that a pinhole would take of the same scene: linear radiance.

    The nearest surface at four places of each layer sample, averaged over the pixel. It is also what the
    picture of any lens tends to when its aperture closes.
    """
    grid = layers.grid
    edges = (
        slice(grid.margin, grid.margin + size * grid.supersampling) for size in (grid.height, grid.width)
    )
    seen = np.asarray(_seen(layers))[*edges]
    blocks = seen.reshape(grid.height, grid.supersampling, grid.width, grid.supersampling, 3)
    return jnp.asarray(blocks.mean(axis=(1, 3)))


@eqx.filter_jit
def _seen(layers: Layers) -> Float[Array, "h w 3"]:
    """Mean radiance of each sample of the grid."""
    shape, radiances = layers.cells.shape[1:], radiance_from_centre(layers)

    def at_place(place: Float[Array, "2"]) -> Float[Array, "h w 3"]:
        dx, dy = (jnp.broadcast_to(place[k], shape) for k in (0, 1))
        # Words are ordered by their nearest disparity.
        nearest = jnp.zeros(shape, dtype=layers.cells.dtype)
        colour = layers.background
        for words, radiance in zip(layers.cells, radiances, strict=True):
            shows = covered(words, dx, dy) & (words > nearest)
            nearest = jnp.where(shows, words, nearest)
            colour = jnp.where(shows[..., None], radiance, colour)
        return colour

    return jax.lax.map(at_place, jnp.asarray(_PLACES, dtype=layers.radiance.dtype)).mean(axis=0)
