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

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._zeros import zeros_after
from focusjax.geometry import LensRay, film_offsets
from focusjax.layers import interval
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._emitter_aim import aim_at
from focusjax.trace._emitter_slots import SLOTS, within_outline
from focusjax.trace._emitter_tiles import TILE
from focusjax.trace._emitters import MOST_PAIRS, Emitters
from focusjax.trace._in_parts import in_parts
from focusjax.trace._march import first_hits
from focusjax.trace._radiances import TracedScene, on_grid
from focusjax.trace._ranges import DisparityRanges
from focusjax.trace._samples import tile_edge
from focusjax.trace._sobol import sobol_points, stirred
from focusjax.trace._walk import path_of

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 22}
_SHARE = 0.5
"""Of the picture's rays: at most so many more are drawn for emitters."""
_STREAM = 1 << 21
"""Number of the seed's stream for them."""
_FARTHEST_OFF = 0.05
"""Samples by which a ray may miss the place it was to pass."""
_TOLERANCE = 2
"""Steps of disparity, for rounding."""
_GOLDEN = 0x9E3779B9


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
    """The light that each pixel gets from emitters, row-major, beyond what is left of them in the layers.

    Every pair of a pixel and a cluster has as many rays: a power of two, at most twice `rays`, the number of
    a pixel's other rays, and so few that all together are about half of those. They are traced some at a
    time; what is not used takes no time.

    Args:
        scene: without the emitters' excess, as of `split_emitters`.
        lens: whose picture it is.
        emitters: as of `split_emitters`.
        ranges: disparities that the rays of pixels can meet.
        seed: chooses the rays.
        rays: of a pixel, on the average.
        pixel_filter: "box", "tent" or "gaussian".
    """
    camera = scene.camera
    pixels = camera.width * camera.height
    together = 1 << min(max(rays // 4, 1).bit_length() - 1, 2)
    most = max(MOST_PAIRS * pixels, -(-int(_SHARE * rays * pixels) // together))
    log_most = (2 * rays).bit_length() - 1
    each = jnp.log2(_SHARE * rays * pixels / jnp.maximum(emitters.pairs, 1).astype(jnp.float32))
    log_each = jnp.clip(jnp.floor(each).astype(jnp.int32), together.bit_length() - 1, log_most)
    parts = jnp.int32(1) << (log_each - (together.bit_length() - 1))
    used = jnp.minimum(emitters.pairs * parts, most)
    size = max(1, min(_RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // together, most))
    draw = _Drawing(scene, emitters, ranges, stirred(seed, _STREAM), pixel_filter, log_most)

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

            def of_lens(lens: AbstractLens) -> Float[Array, "g 3"]:
                brought = draw.brought(lens, at_column, at_row, of, number.reshape(-1), log_each)
                return jnp.stack([colour.reshape(together, -1).sum(axis=0) for colour in brought], axis=1)

            share = jnp.exp2(-log_each.astype(sums.dtype))
            pixel = jnp.where(group < used, row * camera.width + column, pixels)
            return sums.at[pixel].add(in_colour(of_lens, lens) * share, mode="drop")

        return jax.lax.cond(chunk * size < used, jax.checkpoint(traced), lambda sums: sums, sums), None

    nothing = zeros_after(emitters.pairs, (pixels, 3))
    return jax.lax.scan(add, nothing, jnp.arange(-(-most // size), dtype=jnp.int32))[0]


class _Drawing:
    """How rays for emitters are drawn and traced; all arguments are those of `emitter_light`."""

    def __init__(
        self,
        scene: TracedScene,
        emitters: Emitters,
        ranges: DisparityRanges,
        seed: UInt[Array, ""],
        pixel_filter: str,
        log_most: int,
    ) -> None:
        self._scene, self._slots, self._ranges, self._seed = scene, emitters.slots, ranges, seed
        self._filter, self._most = pixel_filter, 1 << log_most
        self._edge = tile_edge(self._most)

    def brought(
        self,
        lens: AbstractLens,
        column: Int[Array, " n"],
        row: Int[Array, " n"],
        cluster: Int[Array, " n"],
        number: Int[Array, " n"],
        log_each: Int[Array, ""],
    ) -> tuple[Float[Array, " n"], ...]:
        """Red, green and blue of ray `number` of 2^log_each for each pair of a pixel and a cluster."""
        scene, slots = self._scene, self._slots

        def aimed(some: tuple[Array, ...]) -> tuple[Array, ...]:
            return self._aimed(lens, *some, log_each=log_each)

        a_x, a_y, b_x, b_y, value, slot, chance = in_parts(aimed, (column, row, cluster, number))
        least, largest, _ = self._ranges.at(column, row)
        ray = LensRay(jnp.stack([a_x, a_y], axis=-1), jnp.stack([b_x, b_y], axis=-1), value)
        # A ray that carries nothing gets a path of no steps, on which it meets nothing.
        paths = jax.vmap(path_of)(on_grid(ray, scene.grid), least, jnp.where(value > 0, largest, 0.0))
        hits = first_hits(scene.volume, paths, None if scene.volume.opacity is None else chance)
        value = jnp.where(self._reached(hits, cluster, slot), value, 0.0)
        return tuple(value * plane.at[slot].get(mode="promise_in_bounds") for plane in slots.power)

    def _aimed(
        self,
        lens: AbstractLens,
        column: Int[Array, " n"],
        row: Int[Array, " n"],
        cluster: Int[Array, " n"],
        number: Int[Array, " n"],
        log_each: Int[Array, ""],
    ) -> tuple[Array, ...]:
        """Rays, in output pixels, what each carries per power of its slot, that slot, and its chance."""
        scene, slots, edge, grid = self._scene, self._slots, self._edge, self._scene.grid
        real = jnp.zeros(()).dtype
        # Clusters that a pixel sees have different points each.
        block = _z_order((column + 7 * cluster) % edge, (row + 11 * cluster) % edge)
        index = (block << log_each) + number
        u, v, x, y = sobol_points(index, self._seed, 4, most=edge**2 * self._most)
        x = column.astype(real) + film_offsets(self._filter, x)
        y = row.astype(real) + film_offsets(self._filter, y)
        slot, u = slots.drawn(cluster, u)

        def look(plane: Array) -> Array:
            return plane.at[slot].get(mode="promise_in_bounds")

        inside = slot - cluster * SLOTS
        dx, dy = within_outline(look(slots.word), u - 0.5, v - 0.5)
        dx, dy = dx + 0.5, dy + 0.5
        to_x = ((slots.column[cluster] + inside % TILE).astype(real) + dx - grid.margin) / grid.supersampling
        to_y = ((slots.row[cluster] + inside // TILE).astype(real) + dy - grid.margin) / grid.supersampling
        slope_x, slope_y = (look(plane) for plane in slots.slope)
        change = (slope_x * (dx - 0.5) + slope_y * (dy - 0.5)) / grid.supersampling
        disparity, share = look(slots.disparity) + change, look(slots.share)

        def one(*values: Array) -> tuple[Array, ...]:
            x, y, to_x, to_y, disparity, slope_x, slope_y = values
            film, place = jnp.stack([x, y]), jnp.stack([to_x, to_y])
            aim = aim_at(scene.camera, lens, film, place, disparity)
            ray, found = aim.ray, (aim.area > 0) & (aim.off * grid.supersampling < _FARTHEST_OFF)
            density = lens.opening().share(aim.pupil) / jnp.where(found, aim.area, 1.0)
            seen = jnp.abs(1.0 - slope_x * ray.b[0] - slope_y * ray.b[1])
            return *ray.a, *ray.b, jnp.where(found, density * seen * ray.weight, 0.0)

        *ray, value = jax.vmap(one)(x, y, to_x, to_y, disparity, slope_x, slope_y)
        value = jnp.where(share > 0, value / jnp.where(share > 0, share, 1.0), 0.0)
        return *ray, value, slot, self._chances(block, number, log_each)

    def _chances(
        self, block: Int[Array, " n"], number: Int[Array, " n"], log_each: Int[Array, ""]
    ) -> UInt[Array, " n"]:
        """32 bits, evenly spaced for the rays of each pair, as those of `pixel_chances`."""
        each = jnp.exp2(log_each.astype(jnp.float32))
        leap = (each * (_GOLDEN * 2.0**-32)).astype(jnp.uint32) | 1
        spread = (number.astype(jnp.uint32) * leap) << 1 << (31 - log_each).astype(jnp.uint32)
        shift = block.astype(jnp.uint32) * jnp.uint32(_GOLDEN) + stirred(self._seed, 64)
        return spread + shift

    def _reached(
        self, hits: Int[Array, " n"], cluster: Int[Array, " n"], slot: Int[Array, " n"]
    ) -> Bool[Array, " n"]:
        """Whether rays that meet `hits` first reach the sample in `slot` of a cluster."""
        slots, volume = self._slots, self._scene.volume
        layer, place = jnp.divmod(jnp.maximum(hits, 0), volume.columns * volume.rows)
        row, column = jnp.divmod(place, volume.columns)
        down, right = row - slots.row[cluster], column - slots.column[cluster]
        near = (down >= 0) & (down < TILE) & (right >= 0) & (right < TILE) & (layer == slots.layer[cluster])
        mine = cluster * SLOTS + jnp.where(near, down * TILE + right, 0)
        same = near & (slots.share.at[mine].get(mode="promise_in_bounds") > 0)
        met = volume.cells.at[place * volume.layers + layer].get(mode="promise_in_bounds")
        least, most = interval(slots.word.at[slot].get(mode="promise_in_bounds"))
        farther = interval(met)[0] <= most + (most - least) + _TOLERANCE
        return (hits < 0) | same | farther


def _z_order(column: Int[Array, " n"], row: Int[Array, " n"]) -> Int[Array, " n"]:
    """Position along the Z-order (Morton) curve, for edges up to 32."""
    order = jnp.zeros_like(column)
    for bit in range(5):
        order |= ((column >> bit) & 1) << (2 * bit) | ((row >> bit) & 1) << (2 * bit + 1)
    return order
