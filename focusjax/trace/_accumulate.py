"""Radiance, summed over the rays of each pixel by circle of confusion."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Float, Int

from focusjax._few import sum_of_few
from focusjax._whole import divided
from focusjax._zeros import zeros_after
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.trace._coc_bins import CocBins
from focusjax.trace._devices import rays_at_once, summed_over
from focusjax.trace._groups import RayGroups, SomeGroups
from focusjax.trace._radiances import Seen, TracedScene, seen_along
from focusjax.trace._ranges import DisparityRanges
from focusjax.trace._samples import RaySamples, Starts


class PixelSums(eqx.Module):
    """Means over the rays of each pixel, by bin; pixels are row-major.

    Attributes:
        binned: for each bin, the weight times radiance up to white, 1, of its rays; then their weight, once
            [k, p, 4], or for each colour where that differs [k, p, 6].
        over: weight times what is brighter than white [p, 3]. It is never smoothed: a kernel that is off by
            1 % of a lamp is off by much beside it.
    """

    binned: Float[Array, "k p c"]
    over: Float[Array, "p 3"]

    def brought(self) -> Float[Array, "p 3"]:
        """Weight times radiance up to white, of all bins."""
        return sum_of_few(self.binned[..., :3])

    def light(self) -> Float[Array, "p 3"]:
        """Weight of all bins."""
        return jnp.broadcast_to(sum_of_few(self.binned[..., 3:]), self.over.shape)


def no_sums(kinds: int, pixels: int, lens: AbstractLens, groups: Array) -> PixelSums:
    """Those of so many pixels and bins before any ray is traced, when their `groups` are known."""
    lights = 3 if lens.channels() else 1
    return PixelSums(zeros_after(groups, (kinds, pixels, 3 + lights)), zeros_after(groups, (pixels, 3)))


def traced_sums(
    scene: TracedScene,
    lens: AbstractLens,
    samples: RaySamples,
    groups: RayGroups,
    ranges: DisparityRanges,
    bins: CocBins,
    mesh: Mesh | None = None,
    *,
    begin: Int[Array, ""] | int = 0,
    onto: PixelSums | None = None,
) -> PixelSums:
    """The sums of the pixels whose rays are in `groups`; 0 in the others.

    Groups are traced some at a time, in memory that does not grow with their number. Devices of `mesh` share
    them. `groups` and `bins` may be of some pixels in a row, which count from the picture's pixel `begin`;
    the rays are then added `onto` sums that are there already.
    """

    def seen(some: SomeGroups, lens: AbstractLens) -> Seen:
        some = dataclasses.replace(some, pixel=some.pixel + begin)
        return seen_by(some, scene, lens, samples, ranges)

    return summed(seen, lens, groups, bins, groups.pixels, mesh, onto)


def seen_by(
    some: SomeGroups, scene: TracedScene, lens: AbstractLens, samples: RaySamples, ranges: DisparityRanges
) -> Seen:
    """What the rays of some groups see, in the order of `starts_of`."""
    column, row, _, starts = starts_of(some, samples, scene.camera)
    least, largest, depth = ranges.at(column, row)
    least, largest = (jnp.tile(end, some.together) for end in (least, largest))
    return seen_along(scene, lens, starts, least, largest, depth.max())


def starts_of(
    some: SomeGroups, samples: RaySamples, camera: Camera
) -> tuple[Int[Array, " g"], Int[Array, " g"], Int[Array, "s g"], Starts]:
    """Column and row of each group's pixel, the numbers of its rays, and where they start, [s * g].

    Rays of numbers beyond those of the samples start as the last of them. All first rays of groups come
    first, then all second ones, and so on: sums over groups are sums of columns.
    """
    pixel = jnp.minimum(some.pixel, camera.width * camera.height - 1)
    row, column = divided(pixel, camera.width)
    number = jnp.arange(some.together, dtype=jnp.int32)[:, None] + some.first[None]
    of_column, of_row = (jnp.broadcast_to(a[None], number.shape) for a in (column, row))
    starts = samples.at(of_column, of_row, jnp.minimum(number, samples.per_pixel - 1))
    return column, row, number, jax.tree.map(lambda a: a.reshape(-1), starts)


def summed(
    seen: Callable[[SomeGroups, AbstractLens], Seen],
    lens: AbstractLens,
    groups: RayGroups,
    bins: CocBins,
    pixels: int,
    mesh: Mesh | None = None,
    onto: PixelSums | None = None,
) -> PixelSums:
    """Sums over what the rays of each group have `seen`, a function of some groups and of a lens.

    They are added `onto` others, if there are some; not where several devices share the groups.
    """
    kinds, channels = len(bins.least), lens.channels()
    at_once = max(1, rays_at_once() // groups.together)
    devices = 1 if mesh is None else mesh.size
    chunks = -(-groups.length // (at_once * devices)) * devices
    size = -(-groups.length // chunks)

    def add(sums: _Running, work: tuple[Array, ...]) -> tuple[_Running, None]:
        (begin,) = work

        def traced(sums: _Running) -> _Running:
            some = groups.some(begin, size)
            if not channels:
                return _with(sums, seen(some, lens), some, bins, None)
            for channel in channels:
                sums = _with(sums, seen(some, channel.lens), some, bins, channel.colour)
            return sums

        return jax.lax.cond(begin < groups.used, jax.checkpoint(traced), lambda sums: sums, sums), None

    before = no_sums(kinds, pixels, lens, groups.used) if onto is None else onto
    start = before.binned.reshape(kinds * pixels, -1), before.over
    binned, over = summed_over(add, start, (size * jnp.arange(chunks, dtype=jnp.int32),), mesh)
    return PixelSums(binned.reshape(kinds, pixels, -1), over)


_Running = tuple[Float[Array, "r c"], Float[Array, "p 3"]]
"""The arrays of `PixelSums`, all bins in one long column of rows."""


def _with(
    sums: _Running, found: Seen, some: SomeGroups, bins: CocBins, colour: tuple[float, ...] | None
) -> _Running:
    """The sums with what rays of some groups have found, in the shares of their `colour`."""
    binned, over = sums
    pixels, together = len(over), some.together
    weight, disparity, *radiance = (
        a.reshape(together, -1) for a in (found.weight, found.disparity, *found.radiance)
    )
    weight = weight * some.share[None]
    none = jnp.zeros_like(weight)
    shares = (1.0,) if colour is None else colour
    weights = [weight * share if share else none for share in shares]
    # Light of a colour that is left out counts for nothing, whatever it is.
    seen = [
        light if share else none for share, light in zip(shares * (3 // len(shares)), radiance, strict=True)
    ]
    lights = list(zip(weights * (3 // len(weights)), seen, strict=True))
    values = [share * jnp.minimum(light, 1.0) for share, light in lights] + weights
    row = bins.of(some.pixel, disparity) * pixels + some.pixel[None]
    row = jnp.where(some.pixel[None] < pixels, row, len(binned)).reshape(-1)
    binned = binned.at[row].add(jnp.stack(values, axis=-1).reshape(len(row), -1), mode="drop")

    def bright(over: Float[Array, "p 3"]) -> Float[Array, "p 3"]:
        excess = [sum_of_few(share * jnp.maximum(light - 1.0, 0.0)) for share, light in lights]
        return over.at[some.pixel].add(jnp.stack(excess, axis=-1), mode="drop")

    # At white itself each of the two has half of the derivative; what is no number must not get lost.
    below = ((seen[0] < 1.0) & (seen[1] < 1.0) & (seen[2] < 1.0)).all()
    return binned, jax.lax.cond(below, lambda over: over, bright, over)
