"""Which pixels may see which highlights."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.geometry import Camera, filter_radius
from focusjax.lens import AbstractLens
from focusjax.trace._highlights import Highlights, padded

_AT_ONCE = 1 << 18


def who_sees(
    highlights: Highlights, lens: AbstractLens, camera: Camera, pixel_filter: str
) -> tuple[Int[np.ndarray, " q"], Int[np.ndarray, " q"]]:
    """Row-major numbers of pixels, and the parts that some of their rays may meet: all such pairs."""
    low, high = np.asarray(highlights.low), np.asarray(highlights.high)
    wide = filter_radius(pixel_filter)
    reach = np.asarray(_reaches(lens, camera, highlights.disparity))[:, None] + wide
    size = np.array([camera.width, camera.height])
    first = np.clip(np.floor(low - reach), 0, size).astype(np.int64)
    extent = np.clip(np.ceil(high + reach), first, size).astype(np.int64) - first
    ends = np.cumsum(extent.prod(axis=1))
    pixels, parts = [], []
    for start in range(0, int(ends[-1]), _AT_ONCE):
        candidate = np.arange(start, min(start + _AT_ONCE, int(ends[-1])))
        part = np.searchsorted(ends, candidate, side="right")
        row, column = np.divmod(candidate - (ends - extent.prod(axis=1))[part], extent[part, 0])
        film = np.stack([column, row], axis=1) + first[part]
        (middle,), (number,) = padded(low.dtype, film + 0.5), padded(np.int32, part)
        seen = np.asarray(_seen(highlights, lens, camera, middle, number, wide))[: len(part)]
        pixels.append((film[:, 1] * camera.width + film[:, 0])[seen])
        parts.append(part[seen])
    if not pixels:
        return np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int32)
    return np.concatenate(pixels).astype(np.int32), np.concatenate(parts).astype(np.int32)


@eqx.filter_jit
def _reaches(lens: AbstractLens, camera: Camera, disparity: Float[Array, " k"]) -> Float[Array, " k"]:
    return jax.vmap(lambda w: lens.reach(camera, w))(disparity)


@eqx.filter_jit
def _seen(
    highlights: Highlights,
    lens: AbstractLens,
    camera: Camera,
    film: Float[Array, "q 2"],
    part: Int[Array, " q"],
    wide: float,
) -> Bool[Array, " q"]:
    """Whether the footprint of a pixel there reaches the box around the part."""

    def one(film: Array, part: Array) -> Array:
        centre, radius = lens.footprint(camera, film, highlights.disparity[part])
        away = jnp.maximum(jnp.maximum(highlights.low[part] - centre, centre - highlights.high[part]), 0.0)
        return away @ away <= (radius + math.sqrt(2.0) * wide + 0.5) ** 2

    return jax.vmap(one)(film, part)
