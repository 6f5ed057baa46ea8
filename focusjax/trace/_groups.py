"""Which rays are traced: groups of a few rays of one pixel, as flat lists.

Lists are in the order of small square tiles of the picture, so that rays that follow one another read few
places of the layers.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.trace._prefix import prefix_sums

_TILE = 16
"""Edge in pixels."""


class RayGroups(eqx.Module):
    """Groups of `together` rays.

    Attributes:
        pixel: row-major number [g] of each group's pixel; as many as there are pixels where it is unused.
        first: number [g] of its first ray in the table of samples.
        part: how many groups of its pixel come before it [g].
        share: one over the number of its pixel's rays [g].
        used: how many groups there are.
        together: rays of a group (static).
    """

    pixel: Int[Array, " g"]
    first: Int[Array, " g"]
    part: Int[Array, " g"]
    share: Float[Array, " g"]
    used: Int[Array, ""]
    together: int = eqx.field(static=True)


def even_groups(width: int, height: int, rays: int, together: int) -> RayGroups:
    """Groups of a picture in which every pixel has as many rays, a multiple of `together`."""
    per_pixel = rays // together
    length = tiled_length(width, height)
    place = jnp.arange(length * per_pixel, dtype=jnp.int32)
    part = place % per_pixel
    pixel = tiled_pixels(width, height)
    pixel = jnp.repeat(pixel, per_pixel, total_repeat_length=length * per_pixel)
    share = jnp.full(pixel.shape, 1.0 / rays, dtype=jnp.zeros(()).dtype)
    return RayGroups(pixel, together * part, part, share, jnp.int32(len(place)), together)


def groups_of(
    rays: Int[Array, " p"], width: int, height: int, together: int, *, most: int, nested: int = 0
) -> RayGroups:
    """Groups of pixels that have different numbers of rays, multiples of `together`, `most` groups in all.

    Args:
        rays: of each pixel, row-major; 0 for none.
        width: pixels per row.
        height: rows.
        together: rays of a group.
        most: length of the list (static); groups beyond are left out.
        nested: where the table of samples holds those of all smaller numbers of rays, `nested` times a power
            of two, before those of a pixel's own: the smallest number. 0 where it holds but one number.
    """
    pixel = tiled_pixels(width, height)
    count = rays.at[pixel].get(mode="fill", fill_value=0)
    parts = count // together
    before, used = prefix_sums(parts)
    # The position in the tiled order of each group's pixel: marks where pixels begin, summed up.
    start = jnp.where(parts > 0, before, most)
    marks = (
        jnp.zeros(most, dtype=jnp.int32).at[start].max(jnp.arange(len(pixel), dtype=jnp.int32), mode="drop")
    )
    place = running_max(marks)
    number = jnp.arange(most, dtype=jnp.int32)
    part = number - before[place]
    own = count[place]
    first = together * part + (jnp.maximum(own - nested, 0) if nested else 0)
    share = 1.0 / jnp.maximum(own, 1).astype(jnp.zeros(()).dtype)
    unused = width * height
    return RayGroups(
        jnp.where(number < used, pixel[place], unused), first, part, share, jnp.minimum(used, most), together
    )


def running_max(values: Int[Array, " n"]) -> Int[Array, " n"]:
    """Largest value up to each place, of values at least 0; in rows, as prefix sums are."""
    row = 128
    length = values.shape[0]
    rows = jnp.pad(values, (0, -length % row)).reshape(-1, row)
    last = rows.max(axis=1)
    above = running_max(last) if last.shape[0] > 4 * row else jnp.maximum.accumulate(last)
    above = jnp.concatenate([jnp.zeros(1, dtype=values.dtype), above[:-1]])
    inside = jnp.maximum.accumulate(rows, axis=1)
    return jnp.maximum(above[:, None], inside).reshape(-1)[:length]


def tiled_length(width: int, height: int) -> int:
    """Places in the tiled order of a picture, those beyond its right and bottom border included."""
    return -(-width // _TILE) * -(-height // _TILE) * _TILE**2


def tiled_pixels(width: int, height: int) -> Int[Array, " n"]:
    """Row-major numbers of pixels, tile by tile; width x height for places beyond the picture."""
    across = -(-width // _TILE)
    place = jnp.arange(tiled_length(width, height), dtype=jnp.int32)
    tile, inside = place // _TILE**2, place % _TILE**2
    column = tile % across * _TILE + inside % _TILE
    row = tile // across * _TILE + inside // _TILE
    return jnp.where((column < width) & (row < height), row * width + column, width * height)
