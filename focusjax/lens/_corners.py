"""Surfaces over the picture, sampled at the corners of its pixels."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

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


@eqx.filter_jit
def at_corners(
    surface: FocalSurface, camera: Camera
) -> tuple[Float[Array, "rows columns"], Float[Array, "rows columns"]]:
    """Focal disparity and aperture scale of a surface at all pixel corners of `camera`."""
    width, height = camera.width + 1, camera.height + 1
    tall, wide = _TILE
    down, across = -(-height // tall), -(-width // wide)

    def tile(number: Int[Array, ""]) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        rows = number // across * tall + jnp.repeat(jnp.arange(tall), wide)
        columns = number % across * wide + jnp.tile(jnp.arange(wide), tall)
        return surface.at(jnp.stack([columns, rows]).astype(surface.xy.dtype))

    def joined(tiles: Float[Array, "tiles p"]) -> Float[Array, "rows columns"]:
        rows = tiles.reshape(down, across, tall, wide).swapaxes(1, 2)
        return rows.reshape(down * tall, across * wide)[:height, :width]

    focus, scale = (joined(tiles) for tiles in jax.lax.map(tile, jnp.arange(down * across)))
    return focus, scale


def _cell(x: Float[Array, ""], count: int) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """Which of `count` unit intervals holds x, and how far into it x is, 0 to 1."""
    x = jnp.clip(x, 0.0, float(count))
    index = jnp.minimum(jnp.floor(x), count - 1.0)
    return index.astype(int), x - jax.lax.stop_gradient(index)
