"""The first surface that one ray meets: a walk through the layers, at most a sample per step."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax.geometry import LensRay
from focusjax.layers import BELOW_MOST, covered, interval

_OPAQUE = 255
_LAYERS_PER_WORD = 4
_NEXT = 0x4FBD1FED
"""M, for which 8 to 1024 evenly spaced c fill the square of (c, M c) evenly, and that of (c, M^2 c)."""


class Volume(eqx.Module):
    """The layers as flat planes, in the form the walk reads them.

    Attributes:
        cells: packed interval and outline [n] of every sample of every layer.
        scale: dioptres per step of `cells`.
        opacity: in 255ths of all samples, those of four layers in the bytes of each word [n / 4, rounded
            up]; None where all are opaque, and then it costs nothing.
        columns: samples per row (static).
        rows: rows (static).
    """

    cells: UInt[Array, " n"]
    scale: Float[Array, ""]
    opacity: UInt[Array, " m"] | None
    columns: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)


def first_hit(
    volume: Volume,
    ray: LensRay,
    least: Float[Array, ""],
    largest: Float[Array, ""],
    chance: UInt[Array, ""] | None = None,
    *,
    depth: int,
) -> Int[Array, ""]:
    """Index into `volume` of the first sample that `ray` (in grid units) meets; -1 if it meets none.

    The ray is walked in equal steps, each at most one sample long in x and y; the middle of the first is
    at the disparity `largest`, that of the last at `least`. (A range of less than half a sample is one
    step.) A `largest` of 0 says that there is nothing to meet. A step lies in the sample under its middle,
    and meets a layer there when the step's disparities overlap the sample's; of several, the nearest
    counts. Only the first `depth` layers are looked at.

    A sample of opacity alpha stops the share alpha of all rays (stochastic transparency, Enderton 2010), so
    that their mean is the blend of everything they meet: it stops those whose `chance`, a number of 32 bits
    that is spread evenly over the rays of a pixel, is less than alpha of its range. Each such sample that
    lets a ray through gives it another number, c <- M c + 1, which is as evenly spread if the first are
    steps of one length, and independent of it. A ray that stays inside a slanted surface for some steps
    meets it once: in a layer that it met in one step, it meets nothing new in the next.
    """
    # Scalars, not 2-vectors, inside the loop: vmapped, they become whole arrays that XLA fuses into
    # one pass around the look-ups (four times quicker on a CPU).
    (a_x, a_y), (b_x, b_y) = ray.a, ray.b
    layer_size = volume.columns * volume.rows
    length = (largest - least) * jnp.maximum(jnp.abs(b_x), jnp.abs(b_y))
    several = length > 0.5
    steps = jnp.where(several, jnp.ceil(length).astype(jnp.int32) + 1, 1)
    steps = jnp.where(largest > 0, steps, 0)
    stride = (largest - least) / jnp.maximum(steps - 1, 1).astype(largest.dtype)
    start = jnp.where(several, largest + 0.5 * stride, largest)
    per_dioptre = 1.0 / volume.scale
    per_step_x, per_step_y = b_x * volume.scale, b_y * volume.scale

    def unfinished(walk: tuple[Array, ...]) -> Bool[Array, ""]:
        step, hit = walk[:2]
        return (step < steps) & (hit < 0)

    def advance(walk: tuple[Array, ...]) -> tuple[Array, ...]:
        step, _, *passing = walk
        near = start - step.astype(largest.dtype) * stride
        middle = near - 0.5 * stride
        column = jnp.clip((a_x + b_x * middle).astype(jnp.int32), 0, volume.columns - 1)
        row = jnp.clip((a_y + b_y * middle).astype(jnp.int32), 0, volume.rows - 1)
        sample = row * volume.columns + column
        nearest = (near * per_dioptre).astype(jnp.int32) + 1
        farthest = ((near - stride) * per_dioptre).astype(jnp.int32)
        half_way = (nearest + farthest) >> 1
        offset_x, offset_y = a_x - 0.5 - column.astype(a_x.dtype), a_y - 0.5 - row.astype(a_y.dtype)
        best, hit = jnp.uint32(0), jnp.int32(-1)
        inside_before, number = passing or (jnp.uint32(0), jnp.uint32(0))
        inside_now, levels = jnp.uint32(0), jnp.uint32(0)
        for layer in range(depth):
            index = sample + layer * layer_size
            word = volume.cells.at[index].get(mode="promise_in_bounds")
            low, most = interval(word)
            at = jnp.clip(half_way, low, most).astype(offset_x.dtype)
            inside = covered(word, offset_x + per_step_x * at, offset_y + per_step_y * at)
            # Words are ordered by their largest disparity; of two within one step, the earlier is nearer.
            meets = (low <= nearest) & (most >= farthest) & (word > best) & inside
            if volume.opacity is not None:
                place, byte = divmod(layer, _LAYERS_PER_WORD)
                if byte == 0:
                    four = volume.opacity.at[sample + place * layer_size]
                    levels = four.get(mode="promise_in_bounds")
                level, bit = levels >> (8 * byte) & _OPAQUE, jnp.uint32(1 << layer % 32)
                partly = meets & (level < _OPAQUE)
                new = partly & ((inside_before & bit) == 0)
                inside_now |= jnp.where(partly, bit, 0)
                meets &= ~partly | (new & ((number >> 8) < level * ((1 << 24) // _OPAQUE)))
                number = jnp.where(new, number * _NEXT + 1, number)
            best = jnp.where(meets, word | BELOW_MOST, best)
            hit = jnp.where(meets, index, hit)
        return (step + 1, hit, inside_now, number) if passing else (step + 1, hit)

    walk: tuple[Array, ...] = (jnp.int32(0), jnp.int32(-1))
    if volume.opacity is not None:
        assert chance is not None
        walk = (*walk, jnp.uint32(0), chance)
    return jax.lax.while_loop(unfinished, advance, walk)[1]


@jax.jit
def pack_opacity(opacity: Float[Array, "l h w"]) -> UInt[Array, " m"]:
    """The words of `Volume.opacity`."""
    levels = jnp.round(opacity * _OPAQUE).astype(jnp.uint32)
    levels = jnp.pad(levels, ((0, -levels.shape[0] % _LAYERS_PER_WORD), (0, 0), (0, 0)))
    bytes_ = levels.reshape(-1, _LAYERS_PER_WORD, *levels.shape[1:])
    shift = 8 * jnp.arange(_LAYERS_PER_WORD, dtype=jnp.uint32)[None, :, None, None]
    return (bytes_ << shift).sum(axis=1, dtype=jnp.uint32).reshape(-1)
