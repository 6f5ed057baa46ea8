"""Distortion and lateral colour: a picture resampled at the places that a lens's middle rays look at."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.post._straight import middle_of


@jit
def warped(image: Float[Array, "h w 3"], camera: Camera, lens: AbstractLens) -> Float[Array, "h w 3"]:
    """A picture as a lens distorts it, by cubic convolution (Keys 1981); beyond the frame as at its edge.

    Args:
        image: [h, w, 3] linear radiance.
        camera: the frame.
        lens: treats all colours alike.
    """
    height, width = image.shape[:2]
    rows, columns = jnp.meshgrid(jnp.arange(height) + 0.5, jnp.arange(width) + 0.5, indexing="ij")
    points = jnp.stack([columns, rows], axis=-1).reshape(-1, 2).astype(image.dtype)
    places = jax.vmap(lambda point: middle_of(lens, camera, point))(points) - 0.5
    first = jnp.floor(places)
    across, down = ((places - first)[:, axis] for axis in (0, 1))
    column, row = (first[:, axis].astype(int) for axis in (0, 1))
    shares_x, shares_y = _shares(across), _shares(down)
    planes = [image[..., channel].ravel() for channel in range(3)]
    totals = [jnp.zeros_like(planes[0]) for _ in range(3)]
    for dy in range(4):
        line = jnp.clip(row + dy - 1, 0, height - 1) * width
        for dx in range(4):
            index = line + jnp.clip(column + dx - 1, 0, width - 1)
            share = shares_y[dy] * shares_x[dx]
            totals = [total + share * plane[index] for total, plane in zip(totals, planes, strict=True)]
    # Cubic pieces overshoot at edges; there is no light below 0.
    return jnp.maximum(jnp.stack(totals, axis=-1), 0.0).reshape(image.shape)


def _shares(t: Float[Array, " n"]) -> list[Float[Array, " n"]]:
    """Weights of the four pixels around a place, t from the second."""
    u = 1.0 - t
    return [
        -0.5 * t * u * u,
        1.0 + t * t * (1.5 * t - 2.5),
        1.0 + u * u * (1.5 * u - 2.5),
        -0.5 * u * t * t,
    ]
