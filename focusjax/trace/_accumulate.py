"""What rays bring, summed over the rays of each pixel by circle of confusion."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._coc_bins import CocBins
from focusjax.trace._devices import summed_over
from focusjax.trace._groups import RayGroups
from focusjax.trace._radiances import Seen, TracedScene, seen_along
from focusjax.trace._ranges import DisparityRanges
from focusjax.trace._samples import RaySamples, Starts

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 22}
_ROWS = 4096
"""Groups whose rows are made at a time."""


class PixelSums(eqx.Module):
    """Means over the rays of each pixel, row-major.

    Attributes:
        brought: weight times radiance up to white, 1, in each bin [p, k, 3].
        light: weight in each bin [p, k, 1], or [p, k, 3] where it differs from colour to colour.
        over: weight times what is brighter than white [p, 3]. It is never smoothed: a kernel that is off by
            1 % of a lamp is off by much beside it.
    """

    brought: Float[Array, "p k 3"]
    light: Float[Array, "p k l"]
    over: Float[Array, "p 3"]


def traced_sums(
    scene: TracedScene,
    lens: AbstractLens,
    samples: RaySamples,
    groups: RayGroups,
    ranges: DisparityRanges,
    bins: CocBins,
    mesh: Mesh | None = None,
) -> PixelSums:
    """The sums of the pixels whose rays are in `groups`; 0 in the others.

    Groups are traced some at a time, in memory that does not grow with their number; of a list that is not
    used to its end, only what is used. Devices of `mesh` share them.
    """
    camera = scene.camera

    def seen(some: RayGroups, lens: AbstractLens) -> Seen:
        column, row, _, starts = starts_of(some, samples, camera)
        least, largest, depth = ranges.at(column, row)
        least, largest = (jnp.tile(end, some.together) for end in (least, largest))
        return seen_along(scene, lens, starts, least, largest, depth.max())

    return summed(seen, lens, groups, bins, camera.width * camera.height, mesh)


def starts_of(
    some: RayGroups, samples: RaySamples, camera: Camera
) -> tuple[Int[Array, " g"], Int[Array, " g"], Int[Array, "s g"], Starts]:
    """Column and row of each group's pixel, the numbers of its rays, and where they start, [s * g].

    Rays of numbers beyond those of the samples start as the last of them. All first rays of groups come
    first, then all second ones, and so on: sums over groups are sums of columns.
    """
    pixel = jnp.minimum(some.pixel, camera.width * camera.height - 1)
    column, row = pixel % camera.width, pixel // camera.width
    number = jnp.arange(some.together, dtype=jnp.int32)[:, None] + some.first[None]
    of_column, of_row = (jnp.broadcast_to(a[None], number.shape) for a in (column, row))
    starts = samples.at(of_column, of_row, jnp.minimum(number, samples.per_pixel - 1))
    return column, row, number, jax.tree.map(lambda a: a.reshape(-1), starts)


def summed(
    seen: Callable[[RayGroups, AbstractLens], Seen],
    lens: AbstractLens,
    groups: RayGroups,
    bins: CocBins,
    pixels: int,
    mesh: Mesh | None = None,
) -> PixelSums:
    """Sums over what the rays of each group have `seen`, a function of some groups and of a lens."""
    kinds, in_each = len(bins.least), bool(lens.channels())
    at_once = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // groups.together)
    length = groups.pixel.shape[0]
    devices = 1 if mesh is None else mesh.size
    chunks = -(-length // (at_once * devices)) * devices
    # Whole blocks of rows, so that what fills up the last chunk adds little.
    size = -(-length // (chunks * _ROWS)) * _ROWS

    def padded(column: Array, fill: int) -> Array:
        return jnp.pad(column, (0, chunks * size - length), constant_values=fill).reshape(chunks, size)

    columns = [
        padded(column, fill)
        for column, fill in ((groups.pixel, pixels), (groups.first, 0), (groups.part, 0), (groups.share, 0))
    ]

    def rows(some: RayGroups) -> Float[Array, "g c"]:
        def of_lens(lens: AbstractLens) -> Float[Array, "g r c"]:
            return _rows(seen(some, lens), some, bins, in_each=in_each)

        return (in_colour(of_lens, lens) if in_each else of_lens(lens)).reshape(size, -1)

    def add(sums: Float[Array, "p c"], work: tuple[Array, ...]) -> tuple[Float[Array, "p c"], None]:
        number, *chunk = work

        def traced(sums: Float[Array, "p c"]) -> Float[Array, "p c"]:
            some = RayGroups(*chunk, used=jnp.int32(size), together=groups.together)
            return sums.at[some.pixel].add(rows(some), mode="drop")

        return jax.lax.cond(
            number * size < groups.used, jax.checkpoint(traced), lambda sums: sums, sums
        ), None

    nothing = jnp.zeros((pixels, _row_length(kinds, in_each)), dtype=jnp.zeros(()).dtype)
    sums = summed_over(add, nothing, (jnp.arange(chunks, dtype=jnp.int32), *columns), mesh)
    return _apart(sums, kinds, in_each)


def _row_length(kinds: int, in_each: bool) -> int:
    return 6 * kinds + 3 if in_each else 4 * kinds + 3


def _rows(found: Seen, some: RayGroups, bins: CocBins, *, in_each: bool) -> Float[Array, "g r c"]:
    """What `PixelSums` holds of each group, in one row; the three colours along the last axis if `in_each`.

    In a loop over some rows at a time, as XLA for CPU would otherwise look up what rays have seen anew for
    each number of a row.
    """
    kinds, together = len(bins.least), some.together

    def block(values: tuple[Array, ...]) -> Float[Array, "r c b"]:
        pixel, share, weight, disparity, *colours = values
        bin_, weight = bins.of(pixel, disparity), weight * share[None]
        told = jnp.stack([*(weight * jnp.minimum(colour, 1.0) for colour in colours), weight])
        over = jnp.stack([(weight * jnp.maximum(colour - 1.0, 0.0)).sum(axis=0) for colour in colours])
        nearest, farthest = bin_.min(), bin_.max()

        def of_kind(kind: Int[Array, ""]) -> Float[Array, "c b"]:
            # Most blocks have rays of few bins.
            return jax.lax.cond(
                (kind >= nearest) & (kind <= farthest),
                lambda: jnp.where((bin_ == kind)[None], told, 0.0).sum(axis=1),
                lambda: jnp.zeros((4, _ROWS), dtype=told.dtype),
            )

        # A loop, so that bins are worked out once.
        apart = jax.lax.map(of_kind, jnp.arange(kinds, dtype=jnp.int32))
        if in_each:
            light = jnp.broadcast_to(apart[:, 3:], (kinds, 3, _ROWS))
            return jnp.concatenate([apart[:, :3], light, over[None]])
        return jnp.concatenate([apart.reshape(-1, _ROWS), over])[:, None]

    def in_blocks(column: Array) -> Array:
        return jnp.moveaxis(column.reshape(*column.shape[:-1], -1, _ROWS), -2, 0)

    per_ray = [a.reshape(together, -1) for a in (found.weight, found.disparity, *found.radiance)]
    made = jax.lax.map(block, tuple(in_blocks(a) for a in (some.pixel, some.share, *per_ray)))
    return jnp.moveaxis(made, -1, 1).reshape(-1, *made.shape[1:3])


def _apart(sums: Float[Array, "p c"], kinds: int, in_each: bool) -> PixelSums:
    if in_each:
        rows = sums.reshape(len(sums), 2 * kinds + 1, 3)
        return PixelSums(rows[:, :kinds], rows[:, kinds:-1], rows[:, -1])
    planes = sums[:, :-3].reshape(len(sums), kinds, 4)
    return PixelSums(planes[..., :3], planes[..., 3:], sums[:, -3:])
