"""The sharp picture, everything in focus, which needs no rays at all."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.layers import Layers


def render_pinhole(layers: Layers) -> Float[Array, "h w 3"]:
    """The picture that a pinhole would take of the same scene: linear radiance.

    The first layer is just that; each pixel is the mean of its `supersampling` squared samples. It is
    also what the picture of any lens tends to when its aperture closes.
    """
    grid = layers.grid
    first, behind = np.asarray(layers.radiance[0]), np.asarray(layers.background)
    seen = np.where(np.asarray(layers.triangle[0])[..., None] >= 0, first, behind)
    inside = seen[grid.margin : grid.rows - grid.margin, grid.margin : grid.columns - grid.margin]
    blocks = inside.reshape(grid.height, grid.supersampling, grid.width, grid.supersampling, 3)
    return jnp.asarray(blocks.mean(axis=(1, 3)))
