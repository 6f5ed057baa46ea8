"""Motion blur along a picture's velocities (after McGuire et al. 2012, a reconstruction filter)."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._counts import require_counts
from focusjax._programs import jit
from focusjax.post._gather import film_points, gradient_noise

_LEAST_TILE = 16
"""Pixels along a tile's side; twice that is the longest motion that the tiles around a pixel cover."""
_SOFT = 0.05
"""Share of a disparity by which surfaces may differ and still count as one."""
_STILL = 0.5
"""Pixels of motion below which nothing is seen of it."""


def motion_blur(
    image: Float[Array, "_ _ 3"],
    disparity: Float[Array, "_ _"],
    velocity: Float[Array, "_ _ 2"],
    *,
    taps: int = 16,
) -> Float[Array, "h w 3"]:
    """A sharp view, blurred as things move across each pixel.

    At each of some moments a pixel shows what then covers it: what is in front, among things as fast as the
    fastest around (McGuire's tiles), if it has moved that far; else what its own velocity moves there, or,
    where that is hidden by something before it, what the opposite velocity moves there. What a moving thing
    hides is made up from what is beside it. Right for one thing that moves before another, but for what is
    hidden; things of many velocities at one place are not separated.

    Args:
        image: linear radiance.
        disparity: 1/m, which decides what is in front.
        velocity: pixels over the time the shutter is open; the view is in the middle of that.
        taps: places to look at per pixel.

    Raises:
        ValueError: sizes that differ, a velocity that is not finite, or fewer than one tap.
    """
    require_counts(taps=taps)
    if velocity.shape != (*image.shape[:2], 2) or disparity.shape != image.shape[:2]:
        raise ValueError(
            f"the image has shape {image.shape}, the disparity {disparity.shape} and the velocity"
            f" {velocity.shape}; expected [h, w, 3], [h, w] and [h, w, 2]"
        )
    if not np.isfinite(np.asarray(velocity)).all():
        raise ValueError("the velocity has values that are not finite; expected pixels over the exposure")
    farthest = float(np.linalg.norm(np.asarray(velocity), axis=-1).max())
    # What moves across a pixel is half of its way from there at most, and a power of two is a program's.
    side = min(max(_LEAST_TILE, math.ceil(0.5 * farthest)), max(disparity.shape))
    tile = 1 << (side - 1).bit_length()
    return _blurred(image, disparity, velocity.astype(image.dtype), jnp.asarray(taps), tile=tile)


@jit
def _blurred(
    image: Float[Array, "h w 3"],
    disparity: Float[Array, "h w"],
    velocity: Float[Array, "h w 2"],
    taps: Array,
    *,
    tile: int,
) -> Float[Array, "h w 3"]:
    height, width = disparity.shape
    main, own = _main_velocity(velocity, tile).reshape(-1, 2), velocity.reshape(-1, 2)
    depth, speed = disparity.ravel(), jnp.linalg.norm(own, axis=-1)
    planes = [image[..., channel].ravel() for channel in range(3)]
    here = film_points(jnp.arange(height * width), width, image.dtype)
    noise = gradient_noise(here)

    def at(time: Array, way: Array) -> Array:
        """Where what is here at that time is in the view."""
        column, row = jnp.floor(here - time[:, None] * way).astype(int).T
        return jnp.clip(row, 0, height - 1) * width + jnp.clip(column, 0, width - 1)

    def not_behind(one: Array) -> Array:
        """How far what is at some places counts as before what is here, or as the same."""
        return jnp.clip(1.0 + (depth[one] - depth) / (_SOFT * depth + 1e-6), 0.0, 1.0)

    def not_before(one: Array) -> Array:
        return jnp.clip(1.0 + (depth - depth[one]) / (_SOFT * depth + 1e-6), 0.0, 1.0)

    def add(number: Array, lights: list[Array]) -> list[Array]:
        time = (number + noise) / taps - 0.5
        other, same, across = at(time, main), at(time, own), at(-time, own)
        away = jnp.abs(time) * jnp.linalg.norm(main, axis=-1)
        share = jnp.where(away <= 0.5 * speed[other] + _STILL, not_behind(other), 0.0)
        # What comes along from behind something is not in the view: what leaves the other way stands for it.
        along, back = not_before(same), not_before(across)

        def brought(plane: Array) -> Array:
            hidden = back * plane[across] + (1.0 - back) * plane
            return share * plane[other] + (1.0 - share) * (along * plane[same] + (1.0 - along) * hidden)

        return [light + brought(plane) for light, plane in zip(lights, planes, strict=True)]

    lights = jax.lax.fori_loop(0, taps, add, [jnp.zeros_like(depth) for _ in planes])
    found = jnp.stack(lights, axis=-1) / taps
    moves = jnp.linalg.norm(main, axis=-1) > _STILL
    return jnp.where(moves[:, None], found, image.reshape(-1, 3)).reshape(image.shape)


def _main_velocity(velocity: Float[Array, "h w 2"], tile: int) -> Float[Array, "h w 2"]:
    """The largest velocity of each pixel's tile and those around it."""
    height, width = velocity.shape[:2]
    down, across = -(-height // tile), -(-width // tile)
    padded = jnp.pad(velocity, ((0, down * tile - height), (0, across * tile - width), (0, 0)), mode="edge")
    tiles = padded.reshape(down, tile, across, tile, 2).transpose(0, 2, 1, 3, 4)
    most = _largest(tiles.reshape(down, across, -1, 2))
    ringed = jnp.pad(most, ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = jnp.stack(
        [ringed[dy : dy + down, dx : dx + across] for dy in range(3) for dx in range(3)], axis=2
    )
    chosen = _largest(around)
    return jnp.repeat(jnp.repeat(chosen, tile, axis=0), tile, axis=1)[:height, :width]


def _largest(vectors: Float[Array, "*n m 2"]) -> Float[Array, "*n 2"]:
    number = (vectors**2).sum(axis=-1).argmax(axis=-1)
    return jnp.take_along_axis(vectors, number[..., None, None], axis=-2)[..., 0, :]
