"""Motion blur along a picture's velocities (McGuire et al. 2012, a reconstruction filter)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._counts import require_counts

_TILE = 16
"""Pixels along a tile's side; what moves farther than that blurs its neighbours' neighbours only in part."""
_SOFT = 0.05
"""Share of a disparity by which surfaces may differ and still count as one."""
_STILL = 0.5
"""Pixels of motion below which nothing is seen of it."""
_NOISE = (0.06711056, 0.00583715, 52.9829189)


def motion_blur(
    image: Float[Array, "h w 3"],
    disparity: Float[Array, "h w"],
    velocity: Float[Array, "h w 2"],
    *,
    taps: int = 16,
) -> Float[Array, "h w 3"]:
    """A sharp view, blurred along the fastest motion around each pixel.

    Each pixel looks along the largest velocity of the tiles around it. What it meets there counts if it is in
    front and its own motion reaches back, if it is behind and the pixel's own motion reaches it, or if both
    blur over each other. What a moving thing hides is made up from what is beside it.

    Args:
        image: linear radiance.
        disparity: 1/m, which tells what is in front.
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
    return _blurred(image, disparity, velocity.astype(image.dtype), jnp.asarray(taps))


@eqx.filter_jit
def _blurred(
    image: Float[Array, "h w 3"],
    disparity: Float[Array, "h w"],
    velocity: Float[Array, "h w 2"],
    taps: Array,
) -> Float[Array, "h w 3"]:
    height, width = disparity.shape
    main = _main_velocity(velocity).reshape(-1, 2)
    own = jnp.linalg.norm(velocity, axis=-1).ravel()
    depth, planes = disparity.ravel(), [image[..., channel].ravel() for channel in range(3)]
    rows, columns = jnp.divmod(jnp.arange(height * width), width)
    x, y = columns.astype(image.dtype) + 0.5, rows.astype(image.dtype) + 0.5
    noise = jnp.mod(_NOISE[2] * jnp.mod(x * _NOISE[0] + y * _NOISE[1], 1.0), 1.0)
    soft = _SOFT * depth + 1e-6

    def add(number: Array, total: tuple[list[Array], Array]) -> tuple[list[Array], Array]:
        lights, weight = total
        along = (number + noise) / taps - 0.5
        column = jnp.clip(jnp.floor(x + along * main[:, 0]), 0, width - 1).astype(int)
        row = jnp.clip(jnp.floor(y + along * main[:, 1]), 0, height - 1).astype(int)
        index = row * width + column
        away = jnp.abs(along) * jnp.linalg.norm(main, axis=1)
        before = jnp.clip(1.0 + (depth[index] - depth) / soft, 0.0, 1.0)
        behind = jnp.clip(1.0 + (depth - depth[index]) / soft, 0.0, 1.0)
        share = (
            before * _cone(away, own[index])
            + behind * _cone(away, own)
            + 2.0 * _cylinder(away, own[index]) * _cylinder(away, own)
        )
        return [
            light + share * plane[index] for light, plane in zip(lights, planes, strict=True)
        ], weight + share

    # The pixel itself counts the more, the less it moves.
    start = 1.0 / jnp.maximum(own, _STILL)
    lights, weight = jax.lax.fori_loop(0, taps, add, ([start * plane for plane in planes], start))
    found = jnp.stack([light / weight for light in lights], axis=-1)
    moves = jnp.linalg.norm(main, axis=1) > _STILL
    return jnp.where(moves[:, None], found, image.reshape(-1, 3)).reshape(image.shape)


def _cone(away: Float[Array, " n"], speed: Float[Array, " n"]) -> Float[Array, " n"]:
    """Falls from 1 to 0 over half the path."""
    return jnp.clip(1.0 - away / jnp.maximum(0.5 * speed, 1e-3), 0.0, 1.0)


def _cylinder(away: Float[Array, " n"], speed: Float[Array, " n"]) -> Float[Array, " n"]:
    """1 within half the path, with a soft end."""
    half = jnp.maximum(0.5 * speed, 1e-3)
    t = jnp.clip((away - 0.95 * half) / (0.1 * half), 0.0, 1.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)


def _main_velocity(velocity: Float[Array, "h w 2"]) -> Float[Array, "h w 2"]:
    """The largest velocity of each pixel's tile and those around it."""
    height, width = velocity.shape[:2]
    down, across = -(-height // _TILE), -(-width // _TILE)
    padded = jnp.pad(velocity, ((0, down * _TILE - height), (0, across * _TILE - width), (0, 0)), mode="edge")
    tiles = padded.reshape(down, _TILE, across, _TILE, 2).transpose(0, 2, 1, 3, 4)
    most = _largest(tiles.reshape(down, across, -1, 2))
    ringed = jnp.pad(most, ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = jnp.stack(
        [ringed[dy : dy + down, dx : dx + across] for dy in range(3) for dx in range(3)], axis=2
    )
    chosen = _largest(around)
    return jnp.repeat(jnp.repeat(chosen, _TILE, axis=0), _TILE, axis=1)[:height, :width]


def _largest(vectors: Float[Array, "*n m 2"]) -> Float[Array, "*n 2"]:
    number = (vectors**2).sum(axis=-1).argmax(axis=-1)
    return jnp.take_along_axis(vectors, number[..., None, None], axis=-2)[..., 0, :]
