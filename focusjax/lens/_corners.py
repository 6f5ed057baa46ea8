"""Surfaces over the picture, sampled at the corners of its pixels."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from focusjax._parallel import CORES, in_parallel
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._control_points import FocalSurface

_TILE = (16, 32)
"""Rows and columns of places that are worked out together: what they need fits into a core's cache."""


def corner_weights(
    camera: Camera, film_point: Float[Array, "2"], shape: tuple[int, ...]
) -> list[tuple[tuple[Int[Array, ""], Int[Array, ""]], Float[Array, ""]]]:
    """Row, column and share of the four corners around a film point; beyond the frame as on its border.

    Raises:
        ValueError: a surface whose `shape` is not that of the camera's pixel corners.
    """
    rows, columns = shape
    if (columns, rows) != (camera.width + 1, camera.height + 1):
        raise ValueError(
            f"the focal surface was sampled for {columns - 1} x {rows - 1} pixels but the camera has"
            f" {camera.width} x {camera.height}; sample it for this camera"
        )
    (i, u), (j, v) = _cell(film_point[0], camera.width), _cell(film_point[1], camera.height)
    return [
        ((j + step_j, i + step_i), share_j * share_i)
        for step_j, share_j in ((0, 1.0 - v), (1, v))
        for step_i, share_i in ((0, 1.0 - u), (1, u))
    ]


def at_corners(
    surface: FocalSurface, camera: Camera
) -> tuple[Float[Array, "rows columns"], Float[Array, "rows columns"]]:
    """Focal disparity and aperture scale of a surface at all pixel corners of `camera`."""
    width, height = camera.width + 1, camera.height + 1
    tall, wide = _TILE
    down, across = -(-height // tall), -(-width // wide)
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(surface))
    # XLA works out tile after tile on one core of a CPU.
    shares = 1 if traced or jax.default_backend() != "cpu" else CORES
    some = np.array_split(np.arange(shares * -(-down * across // shares)), shares)
    found = in_parallel(lambda numbers: _tiles(surface, jnp.asarray(numbers), across), some)

    def joined(tiles: list[Float[Array, "tiles p"]]) -> Float[Array, "rows columns"]:
        rows = jnp.concatenate(tiles)[: down * across].reshape(down, across, tall, wide).swapaxes(1, 2)
        return rows.reshape(down * tall, across * wide)[:height, :width]

    focus, scale = zip(*found, strict=True)
    return joined(list(focus)), joined(list(scale))


@jit
def _tiles(
    surface: FocalSurface, numbers: Int[Array, " n"], across: int
) -> tuple[Float[Array, "n p"], Float[Array, "n p"]]:
    """Both at the places of some tiles, counted row by row, `across` to a row."""
    tall, wide = _TILE

    def tile(number: Int[Array, ""]) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        rows = number // across * tall + jnp.repeat(jnp.arange(tall), wide)
        columns = number % across * wide + jnp.tile(jnp.arange(wide), tall)
        return surface.at(jnp.stack([columns, rows]).astype(surface.xy.dtype))

    return jax.lax.map(tile, numbers)


def _cell(x: Float[Array, ""], count: int) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """Which of `count` unit intervals holds x, and how far into it x is, 0 to 1."""
    x = jnp.clip(x, 0.0, float(count))
    index = jnp.minimum(jnp.floor(x), count - 1.0)
    return index.astype(int), x - jax.lax.stop_gradient(index)
