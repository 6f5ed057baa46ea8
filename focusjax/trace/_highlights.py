"""Small bright things out of focus: found among the samples of layers, to be traced by rays aimed at them.

A lamp of radiance L that the share p of a pixel's rays meets adds p L^2 to their variance. For small p that
is far more than silhouettes add, and rays that are spread over the lens need many before some meet it. So
such samples are given the mean radiance of all, and what they lack, their excess, is what aimed rays bring
(`_aimed`). A picture is linear in the radiance of samples, so both together are the same picture.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.ndimage
from jaxtyping import Array, Bool, Float, Int

from focusjax.geometry import Camera
from focusjax.layers import NEIGHBOURS, SAME_LAYER, UNJOINED, Layers, interval
from focusjax.lens import AbstractLens

_WHITE = 1.0
_LARGEST_SHARE = 0.125
"""Of the rays that pass a place: what more of them meet is no small thing."""
_LEAST_VARIANCE = 0.25
_EDGE = 16
"""Edge in samples of the largest part that is aimed at as one."""
_MOST_PAIRS = 2
"""Parts that a pixel may see, on the average: each then gets at least an eighth of the other rays."""
_STEP = 0.5
"""Samples beyond a part at which rays may pass its disparity and yet meet it; see `first_hit`."""
_TURNS = 8
_OUT_OF_SIGHT = 1e6
"""Pixels beyond the picture at which nothing is seen."""
_FEWEST = 512
"""Elements that arrays are padded to at least."""
_SIZES = (1.0, 0.95, 0.85, 0.7, 0.5)


class Highlights(eqx.Module):
    """Parts of surfaces that rays are aimed at.

    Lengths m and k are padded, so that a scene that moves needs no other programs: with samples that no slot
    tells of, and with boxes out of all sight.

    Attributes:
        slot: of each sample [n] that the layers hold, its position in the next two; -1 for all others.
        excess: radiance [m, 3] above that which the sample has in the layers that are left.
        part: number [m] of the part that it belongs to.
        low: corner [k, 2] in output pixels of a box that every ray passes that meets the part, at its
            disparity.
        high: the opposite corner.
        disparity: of each part [k], 1/m.
    """

    slot: Int[Array, " n"]
    excess: Float[Array, "m 3"]
    part: Int[Array, " m"]
    low: Float[Array, "k 2"]
    high: Float[Array, "k 2"]
    disparity: Float[Array, " k"]


def split_highlights(layers: Layers, lens: AbstractLens) -> tuple[Layers, Highlights | None]:
    """The layers without what is small and bright as `lens` sees it; and that, if there is any.

    Where the lens works out gloss for each ray, that is no part of it.
    """
    brightest = layers.samples.radiance.max(axis=1)
    if not brightest.size or not float(brightest.max()) > _WHITE:
        return layers, None
    held = np.flatnonzero(np.asarray(layers.cells).ravel())
    number = np.flatnonzero(np.asarray(brightest)[: len(held)] > _WHITE)
    if not len(number):
        return layers, None
    index = held[number]
    disparity = np.asarray(layers.samples.disparity)[number]
    share, radius = _shares(layers, lens, index, disparity)
    rare = share < _LARGEST_SHARE
    if not rare.any():
        return layers, None
    number, index, share, radius = number[rare], index[rare], share[rare], radius[rare]
    radiance = np.asarray(layers.samples.radiance)
    level = np.minimum(radiance[: len(held)], _WHITE).mean(axis=0)
    excess = radiance[number] - level
    part = _parts(index, layers)
    value, pairs = _value_and_pairs(part, excess, share, radius, layers)
    # The best first, no more than so many rays can be spared for.
    order = np.argsort(-value, kind="stable")
    worth = value[order] >= _LEAST_VARIANCE
    kept = np.zeros(len(value), dtype=bool)
    most = _MOST_PAIRS * layers.camera.width * layers.camera.height
    kept[order] = worth & (np.cumsum(pairs[order]) <= most)
    if not kept.any():
        return layers, None
    mine = kept[part]
    part = (np.cumsum(kept) - 1)[part[mine]]
    number, index = number[mine], index[mine]
    slot = np.full(len(brightest), -1, dtype=np.int32)
    slot[number] = np.arange(len(part))
    low, high, middle = _boxes(layers, lens, index, part, _goes_on(layers, held, slot, number, part))
    left, real = radiance.copy(), layers.samples.disparity.dtype
    left[number] = level
    highlights = Highlights(
        jnp.asarray(slot),
        *padded(radiance.dtype, excess[mine]),
        *padded(np.int32, part),
        *padded(real, low, high, fill=-_OUT_OF_SIGHT),
        *padded(real, middle),
    )
    return eqx.tree_at(lambda a: a.samples.radiance, layers, jnp.asarray(left)), highlights


@eqx.filter_jit
def _radii(
    layers: Layers, lens: AbstractLens, index: Int[Array, " n"], disparity: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Radius in pixels of the footprint of a film point that looks at each sample."""

    def one(index: Array, disparity: Array) -> Array:
        return lens.footprint(layers.camera, _place(layers, index, disparity.dtype), disparity)[1]

    return jax.vmap(one)(index, disparity)


def _place(layers: Layers, index: Int[Array, ""], dtype: np.dtype) -> Float[Array, "2"]:
    """Where in the picture the sample at flat `index` lies, in pixels."""
    grid = layers.grid
    on_grid = jnp.stack([index % grid.columns, index // grid.columns % grid.rows]).astype(dtype) + 0.5
    return (on_grid - grid.margin) / grid.supersampling


def _shares(
    layers: Layers, lens: AbstractLens, index: Int[np.ndarray, " n"], disparity: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """About the share of rays past each bright sample that meet one; and the radius in pixels of its blur."""
    grid = layers.grid
    (place,), (at,) = padded(np.int32, index), padded(disparity.dtype, disparity)
    radius = np.asarray(_radii(layers, lens, place, at), dtype=np.float64)[: len(index)]
    row, column = np.divmod(index % grid.size, grid.columns)
    table = np.zeros((grid.rows + 1, grid.columns + 1), dtype=np.int64)
    np.add.at(table, (row + 1, column + 1), 1)
    table = table.cumsum(axis=0).cumsum(axis=1)
    # A square of the footprint's area.
    half = np.maximum(np.round(0.5 * math.sqrt(math.pi) * radius * grid.supersampling), 0).astype(np.intp)
    top, bottom = np.maximum(row - half, 0), np.minimum(row + half + 1, grid.rows)
    left, right = np.maximum(column - half, 0), np.minimum(column + half + 1, grid.columns)
    near = table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
    return near / np.maximum(math.pi * (radius * grid.supersampling) ** 2, 1e-9), radius


def _parts(index: Int[np.ndarray, " n"], layers: Layers) -> Int[np.ndarray, " n"]:
    """Number of the part that each sample belongs to: of what is connected in its layer, at most a square."""
    grid = layers.grid
    layer, place = np.divmod(index, grid.size)
    row, column = np.divmod(place, grid.columns)
    thing, things = np.zeros(len(index), dtype=np.int64), 0
    for number in np.unique(layer):
        mine = layer == number
        y, x = row[mine] - row[mine].min(), column[mine] - column[mine].min()
        there = np.zeros((y.max() + 1, x.max() + 1), dtype=bool)
        there[y, x] = True
        labels, count = scipy.ndimage.label(there, np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
        thing[mine] = labels[y, x] - 1 + things
        things += count
    first = np.full((things, 2), np.iinfo(np.int64).max)
    np.minimum.at(first, thing, np.stack([row, column], axis=1))
    square = (np.stack([row, column], axis=1) - first[thing]) // _EDGE
    keys = np.concatenate([thing[:, None], square], axis=1)
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)


def _value_and_pairs(
    part: Int[np.ndarray, " m"],
    excess: Float[np.ndarray, "m 3"],
    share: Float[np.ndarray, " m"],
    radius: Float[np.ndarray, " m"],
    layers: Layers,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Of each part: the variance of a pixel that sees it and its like, and about how many pixels see it."""
    count = np.bincount(part)
    mean = np.stack([np.bincount(part, excess[:, k]) for k in range(3)], axis=1) / count[:, None]
    share = np.bincount(part, share) / count
    white = np.maximum(share * mean.max(axis=1), _WHITE)
    edge = np.sqrt(count) / layers.grid.supersampling + 2.0 * np.bincount(part, radius) / count + 2.0
    return share * (mean**2).sum(axis=1) / white**2, edge**2


def _goes_on(
    layers: Layers,
    held: Int[np.ndarray, " h"],
    slot: Int[np.ndarray, " n"],
    number: Int[np.ndarray, " m"],
    part: Int[np.ndarray, " m"],
) -> Bool[np.ndarray, " m"]:
    """Whether the surface of each sample continues into a sample of no part or of another."""
    columns, size, index = layers.grid.columns, layers.grid.size, held[number]
    links, out = np.asarray(layers.samples.links)[number].astype(np.int64), np.zeros(len(index), dtype=bool)
    for side, step in enumerate(dy * columns + dx for dx, dy in NEIGHBOURS):
        code = links >> (4 * side) & 15
        joined = code != UNJOINED
        neighbour = index + np.where(joined, (code - SAME_LAYER) * size + step, 0)
        found = slot[np.searchsorted(held, neighbour)]
        out |= joined & ((found < 0) | (part[found] != part))
    return out


def _boxes(
    layers: Layers,
    lens: AbstractLens,
    index: Int[np.ndarray, " m"],
    part: Int[np.ndarray, " m"],
    goes_on: Bool[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
    """Corners in pixels around each part, and its disparity.

    What `goes_on` brings its radiance from half a sample beyond, by interpolation.
    """
    grid, count = layers.grid, int(part.max()) + 1
    words = np.asarray(layers.cells).reshape(-1)[index]
    nearest, farthest = np.full(count, -np.inf), np.full(count, np.inf)
    # Rays meet a sample anywhere in its interval, and half a step beyond.
    least, most = (
        np.asarray(end, dtype=np.float64)[: len(part)] for end in interval(*padded(np.uint32, words))
    )
    np.maximum.at(nearest, part, most + 1)
    np.minimum.at(farthest, part, np.maximum(least - 1, 0))
    nearest, farthest = (ends * float(layers.disparity_scale) for ends in (nearest, farthest))
    middle = 0.5 * (nearest + farthest)
    row, column = np.divmod(index % grid.size, grid.columns)
    place = np.stack([column, row], axis=1)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, part, place)
    np.maximum.at(high, part, place + 1)
    low, high = ((corner - grid.margin) / grid.supersampling for corner in (low, high))
    bent = bends(layers.camera, lens, *padded(layers.disparity_scale.dtype, 0.5 * (low + high), middle))
    moved = float(lens.parallax(layers.camera)) * (nearest - middle)
    mixed = 0.5 * (np.bincount(part, goes_on) > 0)
    beyond = (_STEP + mixed) / grid.supersampling + moved + np.asarray(bent)[:count]
    return low - beyond[:, None], high + beyond[:, None], middle


@eqx.filter_jit
def bends(
    camera: Camera, lens: AbstractLens, film: Float[Array, "k 2"], disparity: Float[Array, " k"]
) -> Float[Array, " k"]:
    """How far in pixels rays of film points are, at a disparity, from where `towards` takes them to be."""

    def of(lens: AbstractLens, film: Array, disparity: Array) -> Array:
        start, slope = towards(camera, lens, film, disparity)

        def bend(size: Array, turn: Array) -> Array:
            point = size * lens.opening().rim(turn)
            ray = lens.ray(camera, film, point)
            # A ray without light may go anywhere.
            return jnp.where(ray.weight > 0, jnp.abs(ray.at(disparity) - start - slope @ point).max(), 0.0)

        # Largest at the rim, or within it where that is dark; twice, as it is looked at in some places only.
        turns = jnp.arange(_TURNS, dtype=film.dtype) / _TURNS
        over_turns = jax.vmap(bend, in_axes=(None, 0))
        return 2.0 * jax.vmap(over_turns, in_axes=(0, None))(jnp.asarray(_SIZES, film.dtype), turns).max()

    colours = [channel.lens for channel in lens.channels()] or [lens]
    bends = [jax.vmap(lambda f, w, each=each: of(each, f, w))(film, disparity) for each in colours]
    return jnp.stack(bends).max(axis=0)


def towards(
    camera: Camera, lens: AbstractLens, film: Float[Array, "2"], disparity: Float[Array, ""]
) -> tuple[Float[Array, "2"], Float[Array, "2 2"]]:
    """Where the ray through the middle of the opening passes a disparity, and how the pupil moves that."""

    def at(pupil: Float[Array, "2"]) -> Float[Array, "2"]:
        return lens.ray(camera, film, pupil).at(disparity)

    middle = jnp.zeros_like(film)
    return at(middle), jax.jacfwd(at)(middle)


def padded(dtype: np.dtype | type, *arrays: np.ndarray, fill: float = 0.0) -> list[Array]:
    """Arrays of one length, on the device, with rows of `fill` up to the next power of two.

    One compiled program then serves for many lengths.
    """
    more = max(_FEWEST, 1 << max(len(arrays[0]) - 1, 0).bit_length()) - len(arrays[0])
    rows = [np.pad(a, [(0, more)] + [(0, 0)] * (a.ndim - 1), constant_values=fill) for a in arrays]
    return [jnp.asarray(a, dtype=dtype) for a in rows]
