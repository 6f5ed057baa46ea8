"""Which rays are traced: groups of a few rays of one pixel, one after the other.

They are in the order of small square tiles of the picture, so that rays that follow one another read few
places of the layers.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.trace._prefix import compacted, prefix_sums, running_max

_TILE = 16
"""Edge in pixels."""


class SomeGroups(eqx.Module):
    """Groups of `together` rays that are traced at a time.

    Attributes:
        pixel: row-major number [g] of each group's pixel; as many as there are pixels where it is unused.
        first: number [g] of its first ray in the table of samples.
        share: one over the number of its pixel's rays [g].
        together: rays of a group (static).
    """

    pixel: Int[Array, " g"]
    first: Int[Array, " g"]
    share: Float[Array, " g"]
    together: int = eqx.field(static=True)


class RayGroups(eqx.Module):
    """All groups of a picture: what they are of each pixel that has any, tile by tile.

    A list of the groups themselves would take as much memory as the picture has rays.

    Attributes:
        pixel: row-major number [n] of each pixel that has rays, tile by tile.
        before: how many groups come before its own [n]; `length` after the last.
        first: number [n] of its first ray in the table of samples.
        share: one over the number of its rays [n].
        used: how many groups there are.
        length: the most there may be (static).
        pixels: how many pixels the picture has (static).
        together: rays of a group (static).
    """

    pixel: Int[Array, " n"]
    before: Int[Array, " n"]
    first: Int[Array, " n"]
    share: Float[Array, " n"]
    used: Int[Array, ""]
    length: int = eqx.field(static=True)
    pixels: int = eqx.field(static=True)
    together: int = eqx.field(static=True)

    def some(self, begin: Int[Array, ""], count: int) -> SomeGroups:
        """So many groups from number `begin` on."""
        number = begin + jnp.arange(count, dtype=jnp.int32)
        # As a sum, where a search is a program for each of its steps.
        place = (self.before <= begin).sum(dtype=jnp.int32) - 1
        ahead = jnp.arange(count, dtype=jnp.int32)
        # Every pixel has a group, so that no more than `count` of them begin here.
        starts = self.before.at[place + ahead].get(mode="fill", fill_value=self.length)
        marks = jnp.zeros(count, dtype=jnp.int32).at[jnp.maximum(starts - begin, 0)].max(ahead, mode="drop")
        place = place + running_max(marks)
        first = self.first[place] + self.together * (number - self.before[place])
        pixel = jnp.where(number < self.used, self.pixel[place], self.pixels)
        return SomeGroups(pixel, first, self.share[place], self.together)


def groups_of(
    rays: Int[Array, " p"], width: int, height: int, together: int, *, most: int, nested: int = 0
) -> RayGroups:
    """Groups of pixels that have different numbers of rays, multiples of `together`, `most` groups in all.

    Args:
        rays: of each pixel, row-major; 0 for none.
        width: pixels per row.
        height: rows.
        together: rays of a group.
        most: how many groups there may be (static); groups beyond are left out.
        nested: where the table of samples holds those of all smaller numbers of rays, `nested` times a power
            of two, before those of a pixel's own: the smallest number. 0 where it holds but one number.
    """
    pixel = tiled_pixels(width, height)
    count = rays.at[pixel].get(mode="fill", fill_value=0)
    kept, total = compacted(count >= together)
    pixel, count = pixel[kept], jnp.where(jnp.arange(len(kept)) < total, count[kept], 0)
    before, used = prefix_sums(count // together)
    return RayGroups(
        pixel=pixel,
        before=jnp.where(count > 0, before, most),
        first=jnp.maximum(count - nested, 0) if nested else jnp.zeros_like(count),
        share=1.0 / jnp.maximum(count, 1).astype(jnp.zeros(()).dtype),
        used=jnp.minimum(used, most),
        length=most,
        pixels=width * height,
        together=together,
    )


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
