"""Which rays are traced: how many of each pixel, in groups of a few of one pixel, one after the other.

They are in the order of small square tiles of the picture, so that rays that follow one another read few
places of the layers.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera
from focusjax.trace._allocate import FEWEST, allocated, counts_for, least_through
from focusjax.trace._known_light import KnownLight
from focusjax.trace._ranges import DisparityRanges
from focusjax.trace._sums import compacted, prefix_sums, running_max

_TILE = 16
"""Edge in pixels of the squares that groups go through the picture by."""
_TOGETHER = 4
_SLACK = 16
"""Halvings of a picture's number of rays, to what rounding may add to it."""


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

    `rays` are those of each pixel, row-major, 0 for none; groups beyond the `most` are left out.

    Where the table of samples holds those of all smaller numbers of rays, `nested` times a power of two,
    before those of a pixel's own, `nested` is the smallest number; it is 0 where the table holds but one.
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


class RayCounts(eqx.Module):
    """Rays of the pixels of a picture.

    Attributes:
        of_pixel: number [p] of each, row-major.
        numbers: all that may occur, increasing (static).
        mean: of all pixels (static).
        together: rays of a group (static).
    """

    of_pixel: Int[Array, " p"]
    numbers: tuple[int, ...] = eqx.field(static=True)
    mean: int = eqx.field(static=True)
    together: int = eqx.field(static=True)

    def groups(self, count: Int[Array, " n"], width: int, height: int) -> RayGroups:
        """Groups of a part of the picture, of so many rows and pixels per row.

        `count` is rays of its pixels, row-major: some of `of_pixel`, or 0 for pixels without rays.
        """
        pixels = len(self.of_pixel)
        # As many as the picture may have, if all of them lie in the part; sums of float32 are off by less.
        all_rays = self.mean * pixels + (self.mean * pixels >> _SLACK)
        most = min(all_rays, self.numbers[-1] * width * height)
        nested = 0 if len(self.numbers) == 1 else FEWEST
        return groups_of(count, width, height, self.together, most=-(-most // self.together), nested=nested)


def ray_group(rays: int, *, even: bool) -> int:
    """How many rays of a pixel are traced together, where all pixels have as many if `even`."""
    return max(k for k in range(1, _TOGETHER + 1) if rays % k == 0) if even or rays < FEWEST else _TOGETHER


def even_counts(camera: Camera, rays: int) -> RayCounts:
    """The same number of rays in every pixel."""
    # XLA would work out at length, while it compiles, what follows from known numbers.
    count = jax.lax.optimization_barrier(jnp.full(camera.width * camera.height, rays, dtype=jnp.int32))
    return RayCounts(count, (rays,), rays, ray_group(rays, even=True))


def adaptive_counts(
    variance: Float[Array, " q"],
    camera: Camera,
    ranges: DisparityRanges,
    known: KnownLight | None,
    rays: int,
) -> RayCounts:
    """Rays by what differs in each pixel: `rays` of them on the average; `variance` is by `contrast`."""
    row, column = jnp.divmod(jnp.arange(camera.width * camera.height, dtype=jnp.int32), camera.width)
    square = ranges.square(column, row)
    if known is None:
        pixels = ranges.pixels(camera.width, camera.height)
        count = allocated(variance, rays, rays, pixels=pixels)[square]
    else:
        least = least_through(known.share[:, 1], rays)
        count = allocated(variance[square], rays, rays, least=least)
    return RayCounts(count, counts_for(rays), rays, _TOGETHER)
