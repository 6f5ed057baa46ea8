"""Sums over the bright samples of square tiles of layers."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax._at_once import at_once
from focusjax.layers import Layers
from focusjax.trace._prefix import compacted

TILE = 16
"""Edge in samples of the squares whose samples make up a cluster."""
_BLOCK = 4
"""Edge in samples of the squares in which bright samples are counted, of all layers together."""


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
