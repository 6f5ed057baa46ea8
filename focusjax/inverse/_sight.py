"""What the lens centre sees of layers, and whose rays they hold."""

import numpy as np
from jaxtyping import Float

from focusjax._programs import jit
from focusjax.layers import Layers
from focusjax.trace import widest_opening

served_share = jit(widest_opening)
"""Compiled, for many lenses of one kind."""


def nearest_in_sight(layers: Layers) -> Float[np.ndarray, "h w"]:
    """Disparity in 1/m of the nearest surface anywhere in each pixel; 0 where there is none."""
    grid = layers.grid
    rows, columns = (
        slice(grid.margin, grid.margin + size * grid.supersampling) for size in (grid.height, grid.width)
    )
    seen = np.asarray(layers.disparity[:, rows, columns]).max(axis=0)
    return seen.reshape(grid.height, grid.supersampling, grid.width, grid.supersampling).max(axis=(1, 3))
