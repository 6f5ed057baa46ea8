"""The samples of clusters of emitters: sums over bright ones of square tiles, and slots to draw them from.

Every cluster has a slot for each sample of its tile, row by row; those of no emitter have no power. Samples
are drawn by their power: with u uniform and C the sums of power up to each slot, over that of the whole
cluster, the slot is the first whose C exceeds u.
"""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._at_once import at_once
from focusjax._whole import taken
from focusjax.layers import Layers, interval
from focusjax.trace._sums import compacted

TILE = 16
"""Edge in samples of the squares whose samples make up a cluster."""
_BLOCK = 4
"""Edge in samples of the squares in which bright samples are counted, of all layers together."""
SLOTS = TILE**2
"""Slots of a cluster."""
_STEEPEST = 7.0
"""By which `_cells` scales the normals of lines."""


class TileSums(eqx.Module):
    """Sums over the bright samples of each tile of each layer, row-major, layer by layer.

    Attributes:
        count: how many they are [t].
        x: column of their centres on the grid [t].
        y: row of their centres [t].
        disparity: 1/m [t].
        excess: red, green and blue above the level, each [t].
        peak: largest excess of a sample in any colour [t]; this is no sum.
        table: peaks of bright samples of all layers above and left of the corners of blocks [r, c], added up.
    """

    count: Float[Array, " t"]
    x: Float[Array, " t"]
    y: Float[Array, " t"]
    disparity: Float[Array, " t"]
    excess: tuple[Float[Array, " t"], ...]
    peak: Float[Array, " t"]
    table: Float[Array, "r c"]


def tiles_across(layers: Layers) -> tuple[int, int]:
    """Tiles per row of a layer, and rows of tiles."""
    return -(-layers.grid.columns // TILE), -(-layers.grid.rows // TILE)


def tile_sums(layers: Layers, bright: Bool[Array, " n"], level: Float[Array, "3"]) -> TileSums:
    """Sums over `bright` samples, some at a time; what is not bright takes no time."""
    grid, real = layers.grid, layers.samples.radiance.dtype
    across, down = tiles_across(layers)
    tiles, (rows, columns) = (
        layers.count * across * down,
        (-(-grid.rows // _BLOCK), -(-grid.columns // _BLOCK)),
    )
    lanes, count = compacted(bright)
    some = at_once(cpu=1 << 14, gpu=1 << 20)
    lanes = jnp.pad(lanes, (0, some))

    def part(k: Int[Array, ""], sums: list[Array]) -> list[Array]:
        number = jax.lax.dynamic_slice(lanes, (k * some,), (some,))
        there = k * some + jnp.arange(some, dtype=jnp.int32) < count
        layer, place = jnp.divmod(layers.samples.index.at[number].get(mode="clip"), grid.size)
        row, column = jnp.divmod(place, grid.columns)
        tile = jnp.where(there, (layer * down + row // TILE) * across + column // TILE, tiles)
        block = jnp.where(there, row // _BLOCK * columns + column // _BLOCK, rows * columns)
        excess = [
            jnp.maximum(layers.samples.radiance[:, c].at[number].get(mode="clip") - level[c], 0.0)
            for c in range(3)
        ]
        disparity = layers.samples.disparity.at[number].get(mode="clip").astype(real)
        one = jnp.ones(some, dtype=real)
        values = [one, column.astype(real) + 0.5, row.astype(real) + 0.5, disparity, *excess]
        peak = jnp.maximum(jnp.maximum(excess[0], excess[1]), excess[2])
        *totals, peaks, counts = sums
        added = [total.at[tile].add(value, mode="drop") for total, value in zip(totals, values, strict=True)]
        peaks = peaks.at[tile].max(peak, mode="drop")
        return [*added, peaks, counts.at[block].add(peak, mode="drop")]

    start = [jnp.zeros(tiles, dtype=real)] * 8 + [jnp.zeros(rows * columns, dtype=real)]
    *totals, peaks, counts = jax.lax.fori_loop(jnp.int32(0), (count + some - 1) // some, part, start)
    table = jnp.cumsum(jnp.cumsum(counts.reshape(rows, columns), axis=0), axis=1)
    count, x, y, disparity, *excess = totals
    return TileSums(count, x, y, disparity, tuple(excess), peaks, jnp.pad(table, ((1, 0), (1, 0))))


def share_of_rays(
    sums: TileSums, x: Float[Array, " t"], y: Float[Array, " t"], radius: Float[Array, " t"]
) -> Float[Array, " t"]:
    """About the share of the rays past a place in each tile that meet samples as bright as its brightest.

    Rays are spread over disks of a `radius` in samples. Bright samples are counted in squares of their area,
    each by its excess over the tile's largest, so that what is not as bright counts for less.
    """
    half = jnp.maximum(0.5 * math.sqrt(math.pi) * radius, 0.5)

    def above_and_left(x: Array, y: Array) -> Array:
        """Bright samples there, evenly spread within blocks."""
        last_row, last_column = (size - 1 for size in sums.table.shape)
        x, y = jnp.clip(x / _BLOCK, 0.0, last_column), jnp.clip(y / _BLOCK, 0.0, last_row)
        column = jnp.clip(jnp.floor(x).astype(jnp.int32), 0, last_column - 1)
        row = jnp.clip(jnp.floor(y).astype(jnp.int32), 0, last_row - 1)
        x, y = x - column.astype(x.dtype), y - row.astype(y.dtype)
        upper = (1 - x) * sums.table[row, column] + x * sums.table[row, column + 1]
        lower = (1 - x) * sums.table[row + 1, column] + x * sums.table[row + 1, column + 1]
        return (1 - y) * upper + y * lower

    across = jnp.stack([x - half, x + half])
    left, right = above_and_left(across, (y + half)[None]) - above_and_left(across, (y - half)[None])
    near = right - left
    near = near / jnp.where(sums.peak > 0, sums.peak, 1.0)
    return jnp.maximum(near, 1.0) / jnp.maximum(math.pi * radius**2, 1e-9)


class Slots(eqx.Module):
    """Samples of k clusters, m = k * SLOTS.

    Attributes:
        power: red, green and blue, each [m]: excess radiance times opacity and area, in square pixels.
        upto: C [m].
        share: probability [m] to be drawn; 0 of those that are no emitters. Fixed, whatever the derivative.
        disparity: 1/m at the samples' centres [m].
        slope: change of disparity along x and y, each [m], in 1/m per pixel.
        word: packed interval and outline [m].
        layer: layer [k] of each cluster.
        column: first column [k] of its tile on the grid.
        row: first row [k].
    """

    power: tuple[Float[Array, " m"], ...]
    upto: Float[Array, " m"]
    share: Float[Array, " m"]
    disparity: Float[Array, " m"]
    slope: tuple[Float[Array, " m"], ...]
    word: UInt[Array, " m"]
    layer: Int[Array, " k"]
    column: Int[Array, " k"]
    row: Int[Array, " k"]

    def columns_and_rows(self) -> tuple[Int[Array, " m"], Int[Array, " m"]]:
        """Of every slot, on the grid."""
        inside = jnp.arange(SLOTS, dtype=jnp.int32)
        column = self.column[:, None] + (inside % TILE)[None]
        row = self.row[:, None] + (inside // TILE)[None]
        return column.reshape(-1), row.reshape(-1)

    def middles(self) -> tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, " k"]]:
        """Mean column, row and disparity of each cluster's light; 0 where there is none."""
        column, row = self.columns_and_rows()
        real = self.share.dtype

        def mean(values: Array) -> Array:
            return (self.share * values).reshape(-1, SLOTS).sum(axis=1)

        return mean(column.astype(real) + 0.5), mean(row.astype(real) + 0.5), mean(self.disparity)

    def only(self, kept: Bool[Array, " m"]) -> "Slots":
        """Those that are kept; the others lose their power."""
        power = tuple(jnp.where(kept, plane, 0.0) for plane in self.power)
        return dataclasses.replace(self, power=power, share=jnp.where(kept, self.share, 0.0))

    def drawn(self, cluster: Int[Array, " n"], u: Float[Array, " n"]) -> tuple[Array, Array]:
        """Slots [n] of samples of a cluster for uniform `u`, and where between 0 and 1 u lies within them."""

        def halve(step: Array, slot: Array) -> Array:
            width = jnp.int32(SLOTS // 2) >> step
            end = taken(self.upto, slot + (width - 1))
            return slot + jnp.where(u >= end, width, 0)

        slot = jax.lax.fori_loop(jnp.int32(0), jnp.int32(SLOTS.bit_length() - 1), halve, cluster * SLOTS)
        end, share = (taken(plane, slot) for plane in (self.upto, self.share))
        within = (u - (end - share)) / jnp.where(share > 0, share, 1.0)
        return slot, jnp.clip(within, 0.0, 1.0)


def slots_of(
    layers: Layers,
    radiance: Float[Array, "n 3"],
    tile: Int[Array, " k"],
    wanted: Bool[Array, " k"],
    level: Float[Array, "3"],
    white: float,
) -> tuple[Slots, Int[Array, " m"], Bool[Array, " m"]]:
    """The slots of `wanted` tiles; the number of the sample in each slot, and whether it is an emitter.

    All of `layers` is fixed; `radiance` is that of their samples and may have derivatives.
    """
    grid, scale = layers.grid, layers.disparity_scale
    across, down = tiles_across(layers)
    layer, place = jnp.divmod(tile, across * down)
    first_row, first_column = (TILE * axis for axis in jnp.divmod(place, across))
    inside = jnp.arange(SLOTS, dtype=jnp.int32)
    column = (first_column[:, None] + (inside % TILE)[None]).reshape(-1)
    row = (first_row[:, None] + (inside // TILE)[None]).reshape(-1)
    there = (column < grid.columns) & (row < grid.rows)
    there &= jnp.repeat(wanted, SLOTS)
    layer_of = jnp.repeat(layer, SLOTS)
    index = jnp.where(there, layer_of * grid.size + row * grid.columns + column, 0)
    word = jnp.where(there, layers.cells.reshape(-1)[index], 0)
    there &= word > 0
    number = jnp.where(there, layers.places.number(index), 0)
    colours = [radiance[:, c].at[number].get(mode="clip") for c in range(3)]
    seen = [jax.lax.stop_gradient(colour) for colour in colours]
    member = there & (jnp.maximum(jnp.maximum(seen[0], seen[1]), seen[2]) > white)
    size = covered_share(word) / grid.supersampling**2
    if layers.samples.opacity is not None:
        size = size * layers.samples.opacity.at[number].get(mode="clip")
    size = jnp.where(member, size, 0.0).astype(radiance.dtype)
    plain = [jnp.minimum(colour, level[c]) for c, colour in enumerate(seen)]
    power = tuple(size * (colour - low) for colour, low in zip(colours, plain, strict=True))
    total = jax.lax.stop_gradient(power[0] + power[1] + power[2]).reshape(-1, SLOTS)
    whole = total.sum(axis=1, keepdims=True)
    share = total / jnp.where(whole > 0, whole, 1.0)
    upto = jnp.cumsum(share, axis=1)
    # Exactly 1 from the last emitter on.
    upto = upto / jnp.where(upto[:, -1:] > 0, upto[:, -1:], 1.0)
    disparity = layers.samples.disparity.at[number].get(mode="clip")
    low, high = interval(word)
    length = (high - low + 1).astype(disparity.dtype) * scale
    slope = _slopes(disparity, length, member)
    slots = Slots(
        power,
        upto.reshape(-1),
        share.reshape(-1),
        jnp.where(member, disparity, 0.0),
        tuple(plane * grid.supersampling for plane in slope),
        word,
        layer,
        first_column,
        first_row,
    )
    return slots, number, member


def _slopes(
    disparity: Float[Array, " m"], length: Float[Array, " m"], member: Bool[Array, " m"]
) -> tuple[Float[Array, " m"], ...]:
    """Change of disparity per sample along x and y, by neighbours in the same tile that are close."""
    value, length, member = (plane.reshape(-1, TILE, TILE) for plane in (disparity, length, member))

    def along(axis: int) -> Float[Array, " m"]:
        def shifted(plane: Array, by: int) -> Array:
            return jnp.roll(plane, by, axis=axis)

        line = jnp.arange(TILE).reshape((1, -1, 1) if axis == 1 else (1, 1, -1))
        sums, count = jnp.zeros_like(value), jnp.zeros_like(value)
        for by, inside in ((1, line > 0), (-1, line < TILE - 1)):
            step = (value - shifted(value, by)) * by
            near = jnp.abs(step) <= length + shifted(length, by)
            joined = inside & member & shifted(member, by) & near
            sums, count = sums + jnp.where(joined, step, 0.0), count + joined
        return jnp.clip(sums / jnp.maximum(count, 1.0), -length, length).reshape(-1)

    return along(2), along(1)


def outline(word: UInt[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]:
    """The line that bounds the surface in a sample: it is where x dx + y dy + c >= 0, max(|x|, |y|) = 1.

    Both are 0, and c is positive, where all of the sample is covered.
    """
    real = jnp.zeros(()).dtype
    a, b, c = ((word >> shift & mask).astype(real) for shift, mask in ((9, 15), (5, 15), (0, 31)))
    return (a - 8.0) / _STEEPEST, (b - 8.0) / _STEEPEST, 0.5 * (c - 16.0) / _STEEPEST


def covered_share(word: UInt[Array, "*n"]) -> Float[Array, "*n"]:
    """Share of a sample's square that its surface covers.

    Distances along a normal (1, t) have a trapezoid for their density; see `line_code` in `_cells`.
    """
    x, y, c = outline(word)
    t = jnp.minimum(jnp.abs(x), jnp.abs(y))
    away = jnp.abs(c)
    corner = jnp.maximum(0.5 * (1.0 + t) - away, 0.0)
    rest = jnp.where(away <= 0.5 * (1.0 - t), 0.5 - away, 0.5 * corner**2 / jnp.where(t > 0, t, 1.0))
    rest = jnp.maximum(rest, 0.0)
    return jnp.where((x == 0) & (y == 0), 1.0, jnp.where(c >= 0, 1.0 - rest, rest))


def within_outline(
    word: UInt[Array, "*n"], x: Float[Array, "*n"], y: Float[Array, "*n"]
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Offsets in samples from a sample's centre, -1/2 to 1/2, moved along the normal to its covered side."""
    a, b, c = outline(word)
    most = 0.5 * (jnp.abs(a) + jnp.abs(b))
    distance = a * x + b * y
    inside = -c + (distance + most) * (most + c) / jnp.where(most > 0, 2.0 * most, 1.0)
    move = jnp.where(most > 0, inside - distance, 0.0) / jnp.where(most > 0, a**2 + b**2, 1.0)
    return jnp.clip(x + move * a, -0.5, 0.5), jnp.clip(y + move * b, -0.5, 0.5)
