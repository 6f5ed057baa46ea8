"""Emitter importance sampling: the light of emitters, by rays drawn for them.

For a film point p let q(v) be the place where the ray through the aperture point v passes an emitter. With s
the aperture's share of light per area, W the ray's weight and L the excess radiance along it, the mean over
the aperture becomes an integral over the emitter's surface:

    integral of s(v) W L dv = integral of s(v) W L |1 - g . b| / |det dq/dv| dq,

where b is the ray's change of place per dioptre and g the surface's change of disparity per pixel, which
foreshortens it. A place q is drawn by the power of a cluster's samples, and evenly within one; v follows
from it (`focusjax.trace._emitter_aim`). So a ray carries the power of the whole cluster times s W / |det|,
which for a thin lens is the same for all rays with nothing in their way.

A ray carries nothing if v lies beside the aperture, or if something hides the emitter: what the ray meets
first, by the same walk as every ray's, is then no sample of the cluster, and nearer.
"""

import dataclasses
from collections.abc import Callable
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._few import sum_of_few
from focusjax._whole import divided, taken
from focusjax._zeros import zeros_after
from focusjax.geometry import Camera, LensRay, film_offsets
from focusjax.layers import Grid, interval
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._devices import rays_at_once
from focusjax.trace._emitter_aim import aim_at
from focusjax.trace._emitter_slots import SLOTS, TILE, Slots, within_outline
from focusjax.trace._emitters import MOST_PAIRS, Emitters
from focusjax.trace._in_parts import in_parts
from focusjax.trace._march import first_hits
from focusjax.trace._radiances import TracedScene, on_grid
from focusjax.trace._ranges import DisparityRanges
from focusjax.trace._samples import tile_edge, z_order
from focusjax.trace._sobol import sobol_points, stirred
from focusjax.trace._walk import Volume, path_of

_SHARE = 0.5
"""Of the picture's rays: at most so many more are drawn for emitters."""
_STREAM = 1 << 21
"""Number of the seed's stream for them."""
FARTHEST_OFF = 0.05
"""Samples by which a ray may miss the place it was to pass."""
_TOLERANCE = 2
"""Steps of disparity, for rounding."""
_GOLDEN = 0x9E3779B9


class Pairs(eqx.Module):
    """Rays of pairs of a pixel and a cluster that it may see.

    Attributes:
        column: of the pixel [n].
        row: of the pixel [n].
        cluster: number [n].
        number: of the ray [n] among those of its pair.
    """

    column: Int[Array, " n"]
    row: Int[Array, " n"]
    cluster: Int[Array, " n"]
    number: Int[Array, " n"]

    def columns(self) -> tuple[Int[Array, " n"], ...]:
        """All of them, in the order of attributes."""
        return self.column, self.row, self.cluster, self.number


Brought: TypeAlias = Callable[["Drawing", AbstractLens, Pairs], tuple[Float[Array, " n"], ...]]
"""Red, green and blue that each ray of pairs brings. Its rays come in groups of `together` of one pair: all
first ones of groups, then all second ones, and so on."""


def light_of_pairs(
    emitters: Emitters,
    camera: Camera,
    lens: AbstractLens,
    brought: Brought,
    seed: UInt[Array, ""],
    *,
    rays: int,
    pixel_filter: str,
) -> Float[Array, "p 3"]:
    """The light that each pixel gets from emitters, row-major.

    Every pair of a pixel and a cluster has as many rays: a power of two, at most twice `rays`, the number of
    a pixel's other rays on the average, and so few that all together are about half of those. They are traced
    some at a time; what is not used takes no time. `brought` says what rays bring, from how they are drawn.
    """
    pixels = camera.width * camera.height
    together = together_of(rays)
    most = max(MOST_PAIRS * pixels, -(-int(_SHARE * rays * pixels) // together))
    log_most = (2 * rays).bit_length() - 1
    each = jnp.log2(_SHARE * rays * pixels / jnp.maximum(emitters.pairs, 1).astype(jnp.float32))
    log_each = jnp.clip(jnp.floor(each).astype(jnp.int32), together.bit_length() - 1, log_most)
    # Worked out once, not anew wherever it is used, where it could be rounded otherwise.
    log_each = jax.lax.optimization_barrier(log_each)
    parts = jnp.int32(1) << (log_each - (together.bit_length() - 1))
    used = jnp.minimum(emitters.pairs * parts, most)
    size = max(1, min(rays_at_once() // together, most))
    draw = Drawing(emitters.slots, stirred(seed, _STREAM), log_each, pixel_filter, 1 << log_most)

    def add(sums: Float[Array, "p 3"], chunk: Int[Array, ""]) -> tuple[Float[Array, "p 3"], None]:
        def traced(sums: Float[Array, "p 3"]) -> Float[Array, "p 3"]:
            group = chunk * size + jnp.arange(size, dtype=jnp.int32)
            pair = jnp.minimum(group // parts, jnp.maximum(emitters.pairs - 1, 0))
            cluster = jnp.searchsorted(emitters.before, pair, side="right").astype(jnp.int32) - 1
            inside, across = pair - emitters.before[cluster], emitters.across[cluster]
            column = emitters.left[cluster] + inside % across
            row = emitters.top[cluster] + inside // across
            number = jnp.arange(together, dtype=jnp.int32)[:, None] + (group % parts * together)[None]
            # All first rays of groups, then all second ones: sums over groups are sums of columns.
            at_column, at_row, of = (jnp.tile(values, together) for values in (column, row, cluster))
            some = Pairs(at_column, at_row, of, number.reshape(-1))

            def of_lens(lens: AbstractLens) -> Float[Array, "g 3"]:
                colours = brought(draw, lens, some)
                return jnp.stack([sum_of_few(colour.reshape(together, -1)) for colour in colours], axis=1)

            share = jnp.exp2(-log_each.astype(sums.dtype))
            pixel = jnp.where(group < used, row * camera.width + column, pixels)
            return sums.at[pixel].add(in_colour(of_lens, lens) * share, mode="drop")

        return jax.lax.cond(chunk * size < used, jax.checkpoint(traced), lambda sums: sums, sums), None

    nothing = zeros_after(emitters.pairs, (pixels, 3))
    return jax.lax.scan(add, nothing, jnp.arange(-(-most // size), dtype=jnp.int32))[0]


def together_of(rays: int) -> int:
    """Rays of a group, for so many rays of a pixel."""
    return 1 << min(max(rays // 4, 1).bit_length() - 1, 2)


class Drawn(eqx.Module):
    """Places [n] on emitters.

    Attributes:
        slot: whose they are.
        share: probability of that slot in its cluster.
        place: x and y in output pixels [n 2].
        disparity: there, in 1/m.
        slope: its change along x and y [n 2], in 1/m per pixel.
    """

    slot: Int[Array, " n"]
    share: Float[Array, " n"]
    place: Float[Array, "n 2"]
    disparity: Float[Array, " n"]
    slope: Float[Array, "n 2"]

    def of_slot(self, value: Float[Array, " n"]) -> Float[Array, " n"]:
        """What rays carry per power of their slot, from that per power of their cluster."""
        return jnp.where(self.share > 0, value / jnp.where(self.share > 0, self.share, 1.0), 0.0)


@dataclasses.dataclass(frozen=True)
class Drawing:
    """How rays of pairs are drawn: by points of a Sobol sequence, a block for each pair.

    Attributes:
        slots: of the emitters.
        seed: chooses them.
        log_each: base-2 logarithm of the number of rays of a pair.
        pixel_filter: where film points lie.
        most: rays that a pair may have.
    """

    slots: Slots
    seed: UInt[Array, ""]
    log_each: Int[Array, ""]
    pixel_filter: str
    most: int

    def points(self, some: Pairs, dimensions: int) -> list[Float[Array, " n"]]:
        """Coordinates of rays' points in the unit hypercube."""
        index = (self._block(some) << self.log_each) + some.number
        return sobol_points(index, self.seed, dimensions, most=tile_edge(self.most) ** 2 * self.most)

    def film(self, some: Pairs, x: Float[Array, " n"], y: Float[Array, " n"]) -> Float[Array, "n 2"]:
        """Film points in their pixels, for uniform `x` and `y`."""
        corner = jnp.stack([some.column, some.row], axis=1).astype(x.dtype)
        offsets = [film_offsets(self.pixel_filter, axis) for axis in (x, y)]
        return corner + jnp.stack(offsets, axis=1)

    def places(self, some: Pairs, grid: Grid, u: Float[Array, " n"], v: Float[Array, " n"]) -> Drawn:
        """Places on samples of the rays' clusters, for uniform `u` and `v`."""
        slots, cluster = self.slots, some.cluster
        slot, u = slots.drawn(cluster, u)

        def look(plane: Array) -> Array:
            return taken(plane, slot)

        inside = slot - cluster * SLOTS
        off = jnp.stack(within_outline(look(slots.word), u - 0.5, v - 0.5), axis=1)
        first = jnp.stack(
            [slots.column[cluster] + inside % TILE, slots.row[cluster] + inside // TILE], axis=1
        )
        place = (first.astype(off.dtype) + off + 0.5 - grid.margin) / grid.supersampling
        slope = [look(plane) for plane in slots.slope]
        change = sum_of_few(jnp.stack(slope) * off.T) / grid.supersampling
        return Drawn(slot, look(slots.share), place, look(slots.disparity) + change, jnp.stack(slope, axis=1))

    def chances(self, some: Pairs) -> UInt[Array, " n"]:
        """32 bits, evenly spaced for the rays of each pair, as those of `pixel_chances`."""
        each = jnp.exp2(self.log_each.astype(jnp.float32))
        leap = (each * (_GOLDEN * 2.0**-32)).astype(jnp.uint32) | 1
        spread = (some.number.astype(jnp.uint32) * leap) << 1 << (31 - self.log_each).astype(jnp.uint32)
        return spread + self._block(some).astype(jnp.uint32) * jnp.uint32(_GOLDEN) + stirred(self.seed, 64)

    def _block(self, some: Pairs) -> Int[Array, " n"]:
        """Which block of points; clusters that a pixel sees have different ones each."""
        edge = tile_edge(self.most)
        return z_order((some.column + 7 * some.cluster) % edge, (some.row + 11 * some.cluster) % edge, bits=5)


def carried(
    camera: Camera,
    lens: AbstractLens,
    film: Float[Array, "2"],
    place: Float[Array, "2"],
    disparity: Float[Array, ""],
    slope: Float[Array, "2"],
    near: float,
) -> tuple[LensRay, Float[Array, ""]]:
    """The ray from a film point to a place, and what it carries per power: s W |1 - g . b| / |det dq/dv|.

    All in output pixels. It carries nothing where no ray passes `near` the place.
    """
    aim = aim_at(camera, lens, film, place, disparity)
    ray, found = aim.ray, (aim.area > 0) & (aim.off < near)
    density = lens.opening().share(aim.pupil) / jnp.where(found, aim.area, 1.0)
    return ray, jnp.where(found, density * jnp.abs(1.0 - sum_of_few(slope * ray.b)) * ray.weight, 0.0)


def reached(
    slots: Slots, volume: Volume, hits: Int[Array, " n"], cluster: Int[Array, " n"], slot: Int[Array, " n"]
) -> Bool[Array, " n"]:
    """Whether rays that meet `hits` first reach the sample in `slot` of a cluster."""
    layer, place = divided(jnp.maximum(hits, 0), volume.columns * volume.rows)
    row, column = divided(place, volume.columns)
    down, right = row - slots.row[cluster], column - slots.column[cluster]
    near = (down >= 0) & (down < TILE) & (right >= 0) & (right < TILE) & (layer == slots.layer[cluster])
    mine = cluster * SLOTS + jnp.where(near, down * TILE + right, 0)
    same = near & (taken(slots.share, mine) > 0)
    met = taken(volume.cells, place * volume.layers + layer)
    least, most = interval(taken(slots.word, slot))
    farther = interval(met)[0] <= most + (most - least) + _TOLERANCE
    return (hits < 0) | same | farther


def emitter_light(
    scene: TracedScene,
    lens: AbstractLens,
    emitters: Emitters,
    ranges: DisparityRanges,
    seed: UInt[Array, ""],
    *,
    rays: int,
    pixel_filter: str,
) -> Float[Array, "p 3"]:
    """The light that each pixel of a still picture gets from emitters, row-major.

    It is what they have beyond what `split_emitters` left of them in the `scene`; `rays` are those of a pixel
    on the average, whose disparities are in `ranges`.
    """
    slots, volume = emitters.slots, scene.volume

    def brought(draw: Drawing, lens: AbstractLens, some: Pairs) -> tuple[Float[Array, " n"], ...]:
        a_x, a_y, b_x, b_y, value, slot, chance = in_parts(
            lambda columns: _aimed(draw, scene, lens, Pairs(*columns)), some.columns()
        )
        least, largest, _ = ranges.at(some.column, some.row)
        ray = LensRay(jnp.stack([a_x, a_y], axis=-1), jnp.stack([b_x, b_y], axis=-1), value)
        # A ray that carries nothing gets a path of no steps, on which it meets nothing.
        paths = jax.vmap(path_of)(on_grid(ray, scene.grid), least, jnp.where(value > 0, largest, 0.0))
        hits = first_hits(volume, paths, None if volume.opacity is None else chance)
        value = jnp.where(reached(slots, volume, hits, some.cluster, slot), value, 0.0)
        return tuple(value * taken(plane, slot) for plane in slots.power)

    return light_of_pairs(emitters, scene.camera, lens, brought, seed, rays=rays, pixel_filter=pixel_filter)


def _aimed(draw: Drawing, scene: TracedScene, lens: AbstractLens, some: Pairs) -> tuple[Array, ...]:
    """Rays, in output pixels, what each carries per power of its slot, that slot, and its chance."""
    u, v, x, y = draw.points(some, 4)
    film, drawn = draw.film(some, x, y), draw.places(some, scene.grid, u, v)
    near = FARTHEST_OFF / scene.grid.supersampling

    def one(film: Array, place: Array, disparity: Array, slope: Array) -> tuple[Array, ...]:
        ray, value = carried(scene.camera, lens, film, place, disparity, slope, near)
        return *ray.a, *ray.b, value

    *ray, value = jax.vmap(one)(film, drawn.place, drawn.disparity, drawn.slope)
    return *ray, drawn.of_slot(value), drawn.slot, draw.chances(some)
