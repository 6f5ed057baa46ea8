"""The first surface that one ray meets: a walk through the layers, at most a sample per step."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._programs import jit
from focusjax._whole import taken
from focusjax.geometry import LensRay
from focusjax.layers import BELOW_MOST, covered, interval

_OPAQUE = 255
_LAYERS_PER_WORD = 4
_UNROLLED = 16
"""Layers that every step looks at without a loop: looking at empty ones takes less time than a loop does."""
_NEXT = 0x4FBD1FED
"""M, for which 8 to 1024 evenly spaced c fill the square of (c, M c) evenly, and that of (c, M^2 c)."""


class Volume(eqx.Module):
    """The layers as flat planes, in the form the walk reads them.

    Attributes:
        cells: packed interval and outline [n] of every sample of every layer, the layers of a sample side by
            side, so that a step reads one place in memory.
        scale: dioptres per step of `cells`.
        deepest: how many layers hold anything where rays are; of use beyond those looked at without a loop.
        opacity: in 255ths of all samples, those of four layers in the bytes of each word [n / 4, rounded
            up], which lie side by side as well; None where all are opaque, and then it costs nothing.
        columns: samples per row (static).
        rows: rows (static).
        layers: number of layers (static).
    """

    cells: UInt[Array, " n"]
    scale: Float[Array, ""]
    deepest: Int[Array, ""]
    opacity: UInt[Array, " m"] | None
    columns: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)
    layers: int = eqx.field(static=True)


@jit
def make_volume(
    cells: UInt[Array, "l h w"], scale: Float[Array, ""], opacity: Float[Array, "l h w"] | None
) -> Volume:
    """The volume of layers with these `cells` and, of what may be seen through, `opacity`."""
    layers, rows, columns = cells.shape

    def side_by_side(words: UInt[Array, "k h w"]) -> UInt[Array, " _"]:
        return jnp.moveaxis(words, 0, -1).reshape(-1)

    packed = None if opacity is None else side_by_side(_pack_opacity(opacity))
    return Volume(side_by_side(cells), scale, jnp.int32(layers), packed, columns, rows, layers)


class Path(eqx.Module):
    """The equal steps in which one ray is walked; see `first_hit`.

    Attributes:
        a_x: grid x at infinity.
        a_y: grid y at infinity.
        b_x: change of x per dioptre.
        b_y: change of y per dioptre.
        start: disparity at which the first step begins.
        stride: disparity from one step to the next.
        steps: how many there are; 0 if there is nothing to meet.
    """

    # Scalars, not 2-vectors: vmapped, they become whole arrays that XLA fuses into one pass around the
    # look-ups (four times quicker on a CPU).
    a_x: Float[Array, "*n"]
    a_y: Float[Array, "*n"]
    b_x: Float[Array, "*n"]
    b_y: Float[Array, "*n"]
    start: Float[Array, "*n"]
    stride: Float[Array, "*n"]
    steps: Int[Array, "*n"]


class Passing(eqx.Module):
    """What a ray knows of the surfaces that let it through, where there are such.

    Attributes:
        inside: a bit for each layer, modulo 32, whose surface the ray met in the step before.
        chance: the number that decides where it stops next.
    """

    inside: UInt[Array, "*n"]
    chance: UInt[Array, "*n"]


Read = Callable[[Array, Array], Array]
"""The words of a long array at some places, all within it."""

_Seen = tuple[Array, Array, Array, Array]
"""The nearest word so far, where it is, the layers the ray is inside, and its chance."""


def path_of(ray: LensRay, least: Float[Array, ""], largest: Float[Array, ""]) -> Path:
    """The steps of `ray` (in grid units) from the disparity `largest` to `least`."""
    (a_x, a_y), (b_x, b_y) = ray.a, ray.b
    length = (largest - least) * jnp.maximum(jnp.abs(b_x), jnp.abs(b_y))
    several = length > 0.5
    steps = jnp.where(several, jnp.ceil(length).astype(jnp.int32) + 1, 1)
    steps = jnp.where(largest > 0, steps, 0)
    stride = (largest - least) / jnp.maximum(steps - 1, 1).astype(largest.dtype)
    start = jnp.where(several, largest + 0.5 * stride, largest)
    return Path(a_x, a_y, b_x, b_y, start, stride, steps)


def gathered(words: Array, at: Array) -> Array:
    """As `Read`, by XLA."""
    return taken(words, at)


def take_step(
    volume: Volume, path: Path, step: Int[Array, ""], passing: Passing | None, read: Read = gathered
) -> tuple[Int[Array, "*n"], Passing | None]:
    """What rays meet in step number `step`, as `first_hit` has it, and what they then know."""
    near = path.start - step.astype(path.start.dtype) * path.stride
    middle = near - 0.5 * path.stride
    column = jnp.clip((path.a_x + path.b_x * middle).astype(jnp.int32), 0, volume.columns - 1)
    row = jnp.clip((path.a_y + path.b_y * middle).astype(jnp.int32), 0, volume.rows - 1)
    sample = row * volume.columns + column
    per_dioptre = 1.0 / volume.scale
    nearest = (near * per_dioptre).astype(jnp.int32) + 1
    farthest = ((near - path.stride) * per_dioptre).astype(jnp.int32)
    half_way = (nearest + farthest) >> 1
    offset_x, offset_y = path.a_x - 0.5 - column.astype(near.dtype), path.a_y - 0.5 - row.astype(near.dtype)
    per_step_x, per_step_y = path.b_x * volume.scale, path.b_y * volume.scale
    chance = jnp.uint32(0) if passing is None else passing.chance

    def look(layer: Int[Array, ""] | int, seen: _Seen) -> _Seen:
        best, hit, inside_now, chance = seen
        word = read(volume.cells, sample * volume.layers + layer)
        low, most = interval(word)
        at = jnp.clip(half_way, low, most).astype(offset_x.dtype)
        inside = covered(word, offset_x + per_step_x * at, offset_y + per_step_y * at)
        # Words are ordered by their largest disparity; of two within one step, the earlier is nearer.
        meets = (low <= nearest) & (most >= farthest) & (word > best) & inside
        if volume.opacity is not None and passing is not None:
            words = -(-volume.layers // _LAYERS_PER_WORD)
            levels = read(volume.opacity, sample * words + layer // _LAYERS_PER_WORD)
            byte = jnp.asarray(layer % _LAYERS_PER_WORD, dtype=jnp.uint32)
            level = levels >> (8 * byte) & _OPAQUE
            bit = jnp.uint32(1) << jnp.asarray(layer % 32, dtype=jnp.uint32)
            partly = meets & (level < _OPAQUE)
            new = partly & ((passing.inside & bit) == 0)
            inside_now |= jnp.where(partly, bit, 0)
            meets &= ~partly | (new & ((chance >> 8) < level * ((1 << 24) // _OPAQUE)))
            chance = jnp.where(new, chance * _NEXT + 1, chance)
        best = jnp.where(meets, word | BELOW_MOST, best)
        hit = jnp.where(meets, sample + layer * (volume.columns * volume.rows), hit)
        return best, hit, inside_now, chance

    seen: _Seen = jnp.uint32(0), jnp.int32(-1), jnp.uint32(0), chance
    first = min(volume.layers, _UNROLLED)
    for layer in range(first):
        seen = look(layer, seen)
    if volume.layers > first:
        seen = jax.lax.fori_loop(jnp.int32(first), volume.deepest, look, seen)
    _, hit, inside_now, chance = seen
    return hit, None if passing is None else Passing(inside_now, chance)


def first_hit(
    volume: Volume,
    ray: LensRay,
    least: Float[Array, ""],
    largest: Float[Array, ""],
    chance: UInt[Array, ""] | None = None,
) -> Int[Array, ""]:
    """Flat index, layer by layer, of the first sample that `ray` (in grid units) meets; -1 if it meets none.

    The ray is walked in equal steps, each at most one sample long in x and y; the middle of the first is
    at the disparity `largest`, that of the last at `least`. (A range of less than half a sample is one
    step.) A `largest` of 0 says that there is nothing to meet. A step lies in the sample under its middle,
    and meets a layer there when the step's disparities overlap the sample's; of several, the nearest
    counts.

    A sample of opacity alpha stops the share alpha of all rays (stochastic transparency, Enderton 2010), so
    that their mean is the blend of everything they meet: it stops those whose `chance`, a number of 32 bits
    that is spread evenly over the rays of a pixel, is less than alpha of its range. Each such sample that
    lets a ray through gives it another number, c <- M c + 1, which is as evenly spread if the first are
    steps of one length, and independent of it. A ray that stays inside a slanted surface for some steps
    meets it once: in a layer that it met in one step, it meets nothing new in the next.
    """
    path = path_of(ray, least, largest)
    passing = None if volume.opacity is None or chance is None else Passing(jnp.zeros_like(chance), chance)

    def unfinished(walk: tuple[Array, Array, Passing | None]) -> Bool[Array, ""]:
        step, hit, _ = walk
        return (step < path.steps) & (hit < 0)

    def advance(walk: tuple[Array, Array, Passing | None]) -> tuple[Array, Array, Passing | None]:
        step, _, passing = walk
        return step + 1, *take_step(volume, path, step, passing)

    return jax.lax.while_loop(unfinished, advance, (jnp.int32(0), jnp.int32(-1), passing))[1]


def _pack_opacity(opacity: Float[Array, "l h w"]) -> UInt[Array, "k h w"]:
    """In 255ths, four layers to a word."""
    levels = jnp.round(opacity * _OPAQUE).astype(jnp.uint32)
    levels = jnp.pad(levels, ((0, -levels.shape[0] % _LAYERS_PER_WORD), (0, 0), (0, 0)))
    bytes_ = levels.reshape(-1, _LAYERS_PER_WORD, *levels.shape[1:])
    shift = 8 * jnp.arange(_LAYERS_PER_WORD, dtype=jnp.uint32)[None, :, None, None]
    return (bytes_ << shift).sum(axis=1, dtype=jnp.uint32)
