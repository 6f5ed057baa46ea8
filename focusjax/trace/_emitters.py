"""Emitters: small bright things out of focus, found among the samples of layers.

A lamp of radiance L that the share p of a pixel's rays meets adds p L^2 to their variance. For small p that
is far more than silhouettes add, and rays that are spread over the aperture need many before some meet it.
So such samples are given a plain level, about the mean radiance of the others, and what exceeds it, their
excess, is brought by rays drawn for them (emitter importance sampling; `focusjax.trace._emitter_pairs`). A
picture is linear in the radiance of samples, so both together are the same picture, whatever is split off.

Emitters are drawn in clusters: the bright samples of one layer in a square of its grid. Everything here has a
static shape: the most valuable clusters are kept, as many as there is room and rays for, each with the
rectangle of pixels that may see it.

Of a body that moves they are those that are out of focus all the while; see `focusjax.trace._body_motion`.
"""

import dataclasses
import itertools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from focusjax._programs import jit_sooner
from focusjax.geometry import Camera, filter_radius
from focusjax.layers import Layers, interval
from focusjax.lens import AbstractLens
from focusjax.trace._body_motion import BodyMotion
from focusjax.trace._emitter_aim import one_to_one
from focusjax.trace._emitter_slots import Slots, TileSums, share_of_rays, slots_of, tile_sums
from focusjax.trace._sums import prefix_sums

WHITE = 1.0
_LARGEST_SHARE = 0.125
"""Of the rays that pass a place: what more of them meet is no small thing."""
_LEAST_VARIANCE = 0.25
MOST_CLUSTERS = 1024
MOST_PAIRS = 6
"""Clusters that a pixel may see, on the average."""
_BEYOND = 0.5
"""Samples beyond a cluster at which rays may pass and yet meet it; see `first_hit`."""
_ROUNDS = 4
_MARGIN = 0.04
"""Of the extent of pixels that may see a cluster: footprints may be larger between the points looked at."""


class Emitters(eqx.Module):
    """Clusters of emitters, the most valuable ones first.

    Attributes:
        slots: their samples.
        left: first column [k] of pixels that may see each.
        top: first row [k].
        across: number of columns [k].
        before: pairs [k] of a pixel and a cluster it may see, in all clusters before.
        pairs: all such pairs; 0 if there are no emitters.
    """

    slots: Slots
    left: Int[Array, " k"]
    top: Int[Array, " k"]
    across: Int[Array, " k"]
    before: Int[Array, " k"]
    pairs: Int[Array, ""]


def may_emit(layers: Layers) -> bool:
    """Whether anything is brighter than white; True where that is not known yet, in compiled functions."""
    radiance = layers.samples.radiance
    if isinstance(radiance, Tracer):
        return True
    # Also where something else is traced.
    with jax.ensure_compile_time_eval():
        return bool(radiance.size) and float(radiance.max()) > WHITE


def split_emitters(
    layers: Layers, lens: AbstractLens, motion: BodyMotion | None = None
) -> tuple[Layers, Emitters]:
    """The layers with a plain level in place of emitters, as `lens` sees them; and the emitters.

    Where the layers have a `motion`, emitters are those of all of its times, and the pixels that may see one
    see it at any of them.

    Differentiable by the radiance of samples: what is chosen counts as fixed, and excess radiance changes as
    the samples' does. Gloss that each ray works out is no part of it.
    """
    left, emitters = _split_off(layers, lens, motion)
    return _with_radiance(layers, left), emitters


def split_at_once(
    layers: Layers, lens: AbstractLens, motion: BodyMotion | None = None
) -> tuple[Layers, Emitters | None]:
    """`split_emitters` by a program of its own; None where nothing is split off, unless that is traced."""
    left, emitters = _split_off_at_once(layers, lens, motion)
    if not isinstance(emitters.pairs, Tracer) and not int(emitters.pairs):
        return layers, None
    return _with_radiance(layers, left), emitters


def _with_radiance(layers: Layers, radiance: Float[Array, "n 3"]) -> Layers:
    return dataclasses.replace(layers, samples=dataclasses.replace(layers.samples, radiance=radiance))


def _split_off(
    layers: Layers, lens: AbstractLens, motion: BodyMotion | None
) -> tuple[Float[Array, "n 3"], Emitters]:
    """Radiance of samples with a plain level in place of emitters, and these."""
    fixed = jax.lax.stop_gradient(layers)

    def split(radiance: Float[Array, "n 3"]) -> tuple[Float[Array, "n 3"], Emitters]:
        return _split(radiance, fixed, lens, motion)

    def nothing(radiance: Float[Array, "n 3"]) -> tuple[Float[Array, "n 3"], Emitters]:
        _, shapes = jax.eval_shape(split, radiance)
        return radiance, jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)

    bright = fixed.samples.radiance.max() > WHITE
    return jax.lax.cond(bright, split, nothing, layers.samples.radiance)


_split_off_at_once = jit_sooner(_split_off)


def _split(
    radiance: Float[Array, "n 3"], layers: Layers, lens: AbstractLens, motion: BodyMotion | None
) -> tuple[Float[Array, "n 3"], Emitters]:
    lens = jax.lax.stop_gradient(lens)
    held = jnp.maximum(jnp.bitwise_count(layers.places.held).sum(dtype=jnp.int32), 1)
    bright = layers.samples.radiance.max(axis=1) > WHITE
    others = [jnp.where(bright, 0.0, plane).sum() for plane in layers.samples.radiance.T]
    level = jnp.stack(others) / held.astype(radiance.dtype)
    sums = tile_sums(layers, bright, level)
    value = _values(sums, layers, lens, motion)
    count = min(MOST_CLUSTERS, value.shape[0])
    best, tile = jax.lax.top_k(value, count)
    slots, number, member = slots_of(layers, radiance, tile, best >= _LEAST_VARIANCE, level, WHITE)
    first, extent = _rectangles(slots, member, layers, lens, motion)
    pairs = _within_budget(first, extent, slots, layers, lens, motion)
    kept = jnp.repeat(pairs > 0, member.shape[0] // count)
    member &= kept
    slots = slots.only(kept)
    before, whole = prefix_sums(pairs)
    # Numbers beyond the last sample are dropped.
    number = jnp.where(member, number, radiance.shape[0])
    planes = [
        plane.at[number].set(jnp.minimum(plane, plain).at[number].get(mode="clip"), mode="drop")
        for plane, plain in zip(radiance.T, level, strict=True)
    ]
    return jnp.stack(planes, axis=1), Emitters(
        slots, first[:, 0], first[:, 1], jnp.maximum(extent[:, 0], 1), before, whole
    )


def _values(
    sums: TileSums, layers: Layers, lens: AbstractLens, motion: BodyMotion | None
) -> Float[Array, " t"]:
    """Variance of a pixel that sees the bright samples of a tile and its like; 0 if they are not small."""
    grid = layers.grid
    count = jnp.maximum(sums.count, 1.0)
    x, y, disparity = (total / count for total in (sums.x, sums.y, sums.disparity))

    def radius(x: Array, y: Array, disparity: Array) -> Array:
        place = (jnp.stack([x, y]) - grid.margin) / grid.supersampling
        if motion is None:
            wide = lens.footprint(layers.camera, place, disparity)[1]
        else:
            wide = _smeared_radius(motion, lens, place, disparity)
        return wide * grid.supersampling

    most = jnp.maximum(jnp.maximum(sums.excess[0], sums.excess[1]), sums.excess[2])
    share = share_of_rays(sums, x, y, jax.vmap(radius)(x, y, disparity))
    # Of light in the colours of the whole tile, as bright as its brightest sample.
    white = jnp.maximum(share * sums.peak, WHITE)
    colours = [total / jnp.where(most > 0, most, 1.0) for total in sums.excess]
    variance = share * (sums.peak / white) ** 2 * (colours[0] ** 2 + colours[1] ** 2 + colours[2] ** 2)
    return jnp.where((sums.count > 0) & (share < _LARGEST_SHARE), variance, 0.0)


def _smeared_radius(
    motion: BodyMotion, lens: AbstractLens, place: Float[Array, "2"], disparity: Float[Array, ""]
) -> Float[Array, ""]:
    """Radius in pixels of a disc as large as what a place of a body is smeared over; 0 through focus.

    Its own disc of radius r, where that is smallest, goes by a length l: pi r^2 + 2 r l.
    """

    def at(matrix: Float[Array, "3 4"]) -> tuple[Array, ...]:
        there, now, ahead = motion.place(place, disparity, matrix)
        radius = lens.footprint(motion.camera, there, now)[1]
        return jnp.where(ahead > 0, radius, 0.0), lens.blur(motion.camera, there, now), there

    radius, blur, way = jax.vmap(at)(motion.matrices)
    least, length = radius.min(), jnp.hypot(*(way[-1] - way[0]))
    smeared = jnp.sqrt(least**2 + 2.0 / math.pi * least * length)
    return jnp.where(blur.min() * blur.max() > 0, smeared, 0.0)


def _rectangles(
    slots: Slots, member: Bool[Array, " m"], layers: Layers, lens: AbstractLens, motion: BodyMotion | None
) -> tuple[Int[Array, "k 2"], Int[Array, "k 2"]]:
    """First column and row of the pixels that may see each cluster, and how many there are of them."""
    grid, count = layers.grid, slots.layer.shape[0]
    column, row = (axis.astype(slots.disparity.dtype) for axis in slots.columns_and_rows())

    def least(values: Array) -> Array:
        return jnp.where(member, values, jnp.inf).reshape(count, -1).min(axis=1)

    low = jnp.stack([least(column), least(row)], axis=1) - _BEYOND
    high = jnp.stack([-least(-column), -least(-row)], axis=1) + 1.0 + _BEYOND
    near, far = (end.astype(column.dtype) * layers.disparity_scale for end in interval(slots.word))
    ends = jnp.stack([jnp.maximum(least(near), 0.0), -least(-far)], axis=1)
    some = member.reshape(count, -1).any(axis=1)
    # Finite numbers where there is nothing.
    low, high, ends = (jnp.where(some[:, None], value, 0.0) for value in (low, high, ends))
    low, high = ((corner - grid.margin) / grid.supersampling for corner in (low, high))
    wide = filter_radius(layers.pixel_filter)

    def seen(low: Array, high: Array, ends: Array) -> tuple[Array, Array]:
        if motion is None:
            return pixels_that_see(layers.camera, lens, low, high, ends, wide)
        return pixels_that_see_in_motion(motion, lens, low, high, ends, wide)

    first, extent = jax.vmap(seen)(low, high, ends)
    # Worked out once: wherever they were worked out anew, a border could be rounded to another pixel.
    return jax.lax.optimization_barrier((first, jnp.where(some[:, None], extent, 0)))


def _within_budget(
    first: Int[Array, "k 2"],
    extent: Int[Array, "k 2"],
    slots: Slots,
    layers: Layers,
    lens: AbstractLens,
    motion: BodyMotion | None,
) -> Int[Array, " k"]:
    """Pairs of each cluster with a pixel; 0 where there is no room for them, or where a caustic is."""
    camera, grid = layers.camera, layers.grid
    x, y, disparity = slots.middles()
    shares = jnp.array([(x, y) for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)], dtype=disparity.dtype)
    whens = disparity[None]
    if motion is not None:
        places = (jnp.stack([x, y], axis=1) - grid.margin) / grid.supersampling

        def when(matrix: Float[Array, "3 4"]) -> Float[Array, " k"]:
            return jax.vmap(lambda place, w: motion.place(place, w, matrix)[1])(places, disparity)

        whens = jax.lax.map(when, motion.matrices[jnp.array([0, -1])])

    def clear(share_and_when: tuple[Array, Array]) -> Array:
        """Of each cluster, at one of the pixels that may see it."""
        share, when = share_and_when
        films = first + share[None] * extent
        return jax.vmap(lambda film, w: one_to_one(camera, lens, film, w))(films, whens[when])

    # One after the other, so that few rays are held at once.
    every = jnp.repeat(shares, len(whens), axis=0), jnp.tile(jnp.arange(len(whens)), len(shares))
    pairs = jnp.where(jax.lax.map(clear, every).all(axis=0), extent.prod(axis=1), 0)
    most = MOST_PAIRS * camera.width * camera.height
    # In floating point, where sums do not overflow.
    room = jnp.cumsum(jnp.minimum(pairs, most + 1).astype(disparity.dtype)) <= most * (1.0 - 2.0**-10)
    return jnp.where(room, pairs, 0)


def pixels_that_see(
    camera: Camera,
    lens: AbstractLens,
    low: Float[Array, "2"],
    high: Float[Array, "2"],
    disparities: Float[Array, "2"],
    wide: float,
) -> tuple[Int[Array, "2"], Int[Array, "2"]]:
    """First column and row, and numbers of columns and rows, of the pixels whose rays may pass a box.

    The footprint of a film point p is a disk with the centre c(p) and radius r(p), so that p sees q only if
    p is within r(p) of q - (c(p) - p). Of a rectangle of film points, starting with the box itself, the
    footprints of nine points bound the next rectangle; a few rounds suffice, as r changes slowly. None
    exceeds the lens's reach.

    The box goes from `low`, its left and top, to `high` in output pixels, and from the least to the largest
    of `disparities` in 1/m; film points lie up to `wide` pixels off their pixel's centre, along x and y.
    """
    shares = jnp.array([(x, y) for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)], dtype=low.dtype)
    reach = jax.vmap(lambda disparity: lens.reach(camera, disparity))(disparities).max()

    def bounds(film: Float[Array, "2"], disparity: Float[Array, ""]) -> tuple[Array, Array]:
        centre, radius = lens.footprint(camera, film, disparity)
        return film - centre - radius, film - centre + radius

    def widen(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        first, last = ends
        films = first[None] + shares * (last - first)[None]
        over_films = jax.vmap(bounds, in_axes=(0, None))
        below, above = jax.vmap(over_films, in_axes=(None, 0))(films, disparities)
        below, above = below.min(axis=(0, 1)), above.max(axis=(0, 1))
        return jnp.maximum(low + below, low - reach), jnp.minimum(high + above, high + reach)

    first, last = jax.lax.fori_loop(0, _ROUNDS, widen, (low, high))
    margin = _MARGIN * (last - first) + wide + 0.5
    size = jnp.array([camera.width, camera.height], dtype=low.dtype)
    # Pixel k has its centre at k + 0.5.
    first = jnp.clip(jnp.floor(first - margin), 0, size)
    last = jnp.clip(jnp.ceil(last + margin), first, size)
    return first.astype(jnp.int32), (last - first).astype(jnp.int32)


def pixels_that_see_in_motion(
    motion: BodyMotion,
    lens: AbstractLens,
    low: Float[Array, "2"],
    high: Float[Array, "2"],
    disparities: Float[Array, "2"],
    wide: float,
) -> tuple[Int[Array, "2"], Int[Array, "2"]]:
    """The same of the pixels whose rays may pass a box of a body at any of its times.

    The rectangle around those of all times at which its place is known: between two, what is straight in
    space is so in the picture. There is none if any of the box is not ahead of the lens all the while. The
    box is that of the body's key camera.
    """
    axes = (low[0], high[0]), (low[1], high[1]), (disparities[0], disparities[1])
    corners = jnp.stack([jnp.stack(corner) for corner in itertools.product(*axes)])

    def at(matrix: Float[Array, "3 4"]) -> tuple[Array, Array, Array]:
        place, now, ahead = jax.vmap(lambda c: motion.place(c[:2], c[2], matrix))(corners)
        first, extent = pixels_that_see(
            motion.camera, lens, place.min(axis=0), place.max(axis=0), jnp.stack([now.min(), now.max()]), wide
        )
        return first, first + extent, ahead.min() > 0

    first, last, ahead = jax.lax.map(at, motion.matrices)
    first = first.min(axis=0)
    return first, jnp.where(ahead.all(), last.max(axis=0) - first, 0)
