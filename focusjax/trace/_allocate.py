"""Adaptive sample allocation: many rays where what they may meet differs, few where it is all alike.

With n well-spread rays of variance V a pixel's mean has a squared error of about V / n^a, a between 1 (at
silhouettes) and 2 (where all is smooth). For a given number of rays over the picture the sum of errors is
least when n is in proportion to V^(1 / (1 + a)); in between lies

    n ~ V^0.4.

V is bounded before any ray is traced, by the variance of what the lens centre sees over the box that holds
all places the pixel's rays can pass (Lee10 section 3.1 finds the disparities they can meet, and the lens
gives their footprint there). Means of radiance and of its square over squares of 1, 2, 4, ... pixels answer
for any box, to a factor of two in its edge. Where the mean is brighter than white, 1, the variance relative
to it counts, as an eye or a film would have it.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._whole import taken
from focusjax.geometry import filter_radius
from focusjax.layers import Layers, RowsOfLayers, by_rows
from focusjax.lens import AbstractLens
from focusjax.trace._gloss import radiance_from_centre
from focusjax.trace._in_parts import in_parts
from focusjax.trace._ranges import EDGE, DisparityRanges

FEWEST = 4
"""Rays of a pixel where nothing differs. All numbers are this times a power of two."""
_MOST_TIMES_MEAN = 8
_EXPONENT = 0.4
_PASSING = 0.8
"""The share of the aperture from which on the fewest rays are enough; of half of it, so are twice as many."""
_MOST_DARK = 4
"""Part of the mean that a pixel gets at most for being dark."""
_ROUNDS = 24
_ROUNDING = 1e-4
"""Octaves by which float32 is off, and far more."""
_TAKEN_IN = 0.5
"""Pixels along the edge of a denoiser's kernel, over the radius of what is blurred."""
_NOTHING = 1e-12
"""Variance below which pixels are alike."""


def counts_for(rays: float) -> tuple[int, ...]:
    """All numbers of rays that a pixel may get where the mean is `rays`, increasing."""
    return tuple(FEWEST << k for k in range(int(_MOST_TIMES_MEAN * rays // FEWEST).bit_length()))


def most_doublings(rays: float | Array) -> int | Int[Array, ""]:
    """How often the fewest rays are doubled at most where the mean is `rays`, which may be traced."""
    if isinstance(rays, Array):
        return jnp.floor(jnp.log2(_MOST_TIMES_MEAN * rays / FEWEST) + 1e-5).astype(jnp.int32)
    return len(counts_for(rays)) - 1


def allocated(
    variance: Float[Array, " p"],
    rays: float | Array,
    most_rays: float | Array,
    *,
    pixels: Int[Array, " p"] | None = None,
    least: Int[Array, " p"] | None = None,
) -> Int[Array, " p"]:
    """Rays for pixels of a given variance: at most `rays` of them a pixel on the average, or four.

    No pixel gets more than those of `counts_for(most_rays)`.

    Args:
        variance: by `contrast`.
        rays: the mean.
        most_rays: the mean of which the largest number is taken; known, where `rays` is traced.
        pixels: how many pixels each variance stands for; one if not given.
        least: rays that each gets however plain it is; four if not given.
    """
    most = most_doublings(most_rays)
    octave = _EXPONENT * jnp.log2(jnp.maximum(variance, _NOTHING))
    stands = jnp.ones_like(octave) if pixels is None else pixels.astype(octave.dtype)

    def counts_at(shift: Float[Array, ""]) -> Int[Array, " p"]:
        count = FEWEST << jnp.clip(jnp.round(octave + shift), 0, most).astype(jnp.int32)
        return count if least is None else jnp.maximum(count, least)

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        many = (stands * counts_at(middle)).sum() > rays * stands.sum()
        return jnp.where(many, low, middle), jnp.where(many, middle, high)

    low, high = -octave.max() - 1.0, most - octave.min() + 1.0
    low, _ = jax.lax.fori_loop(0, _ROUNDS, halve, (low, high))
    # Out of the loop octaves may be rounded otherwise than in it, by which alike pixels would all get twice
    # as many; and so they may wherever counts are asked for, were they worked out anew there.
    return jax.lax.optimization_barrier(counts_at(low - _ROUNDING))


def least_through(light: Float[Array, " p"], rays: float | Array) -> Int[Array, " p"]:
    """So many rays for each pixel that some get through where `light` is a small share.

    However plain a pixel is, rays that are all cut off give no estimate of it. But where it is nearly dark
    little is missed, so that it gets a quarter of the mean at most for that.
    """
    most = jnp.maximum(most_doublings(rays / (_MOST_DARK * _MOST_TIMES_MEAN)), 0)
    octave = jnp.ceil(jnp.log2(_PASSING / jnp.maximum(light, 1e-9)))
    return jnp.where(light > 0, FEWEST << jnp.clip(octave, 0, most).astype(jnp.int32), FEWEST)


def contrast(
    layers: Layers,
    lens: AbstractLens,
    ranges: DisparityRanges,
    pixel_filter: str,
    *,
    smooth: bool = False,
) -> Float[Array, " q"]:
    """Variance of what the lens centre sees, all channels together, over the box of each square's rays.

    If denoising will `smooth` it, that of the mean over as many pixels as its kernels take in where all is
    blurred over r pixels or more: V / (1 + (c r)^2).
    """
    levels = _levels(_moments(layers))
    sizes = np.array([level.shape[:2] for level in levels])
    starts = jnp.asarray(np.cumsum([0, *sizes[:-1].prod(axis=1)]), dtype=jnp.int32)
    rows, columns = jnp.asarray(sizes.T, dtype=jnp.int32)
    planes = jnp.concatenate([level.reshape(-1, 4) for level in levels]).T

    def over_box(low: Float[Array, "2"], high: Float[Array, "2"]) -> list[Float[Array, ""]]:
        """Means by the nine squares around the middle of a box that is one to two of them wide.

        They reach beyond its ends: a lamp that only the rays at the rim of the aperture meet must count.
        """
        level = jnp.floor(jnp.log2(jnp.maximum((high - low).max(), 1.0))).astype(jnp.int32)
        level = jnp.minimum(level, len(levels) - 1)
        x, y = 0.5 * (low + high) * jnp.exp2(-level.astype(low.dtype))
        column, row = jnp.floor(x).astype(jnp.int32), jnp.floor(y).astype(jnp.int32)
        around = jnp.arange(-1, 2, dtype=jnp.int32)
        at_x = jnp.clip(column + around, 0, columns[level] - 1)
        at_y = jnp.clip(row + around, 0, rows[level] - 1)
        places = starts[level] + at_y[:, None] * columns[level] + at_x[None]
        weights = _spline(y - jnp.floor(y))[:, None] * _spline(x - jnp.floor(x))[None]
        return [(weights * taken(plane, places)).sum() for plane in planes]

    def of_square(x: Array, y: Array, least: Array, largest: Array) -> Float[Array, ""]:
        low, high, blur = _box(layers, lens, pixel_filter, jnp.stack([x, y]), least, largest)
        red, green, blue, square = over_box(low, high)
        white = jnp.maximum(jnp.maximum(jnp.maximum(red, green), blue), 1.0)
        variance = jnp.maximum(square - red**2 - green**2 - blue**2, 0.0) / white**2
        return variance / (1.0 + (_TAKEN_IN * blur) ** 2) if smooth else variance

    x, y = ranges.middles().T
    squares = x, y, ranges.least, ranges.largest
    return in_parts(lambda some: (jax.vmap(of_square)(*some),), squares)[0]


def _spline(share: Float[Array, ""]) -> Float[Array, "3"]:
    """Weights of the quadratic B-spline for the three squares around a place within the middle one."""
    before, after = 0.5 * (1.0 - share) ** 2, 0.5 * share**2
    return jnp.stack([before, 1.0 - before - after, after])


def _levels(base: Float[Array, "h w 4"]) -> list[Float[Array, "_ _ 4"]]:
    """Means over squares of 1, 2, 4, ... pixels; those at the end of an odd side are repeated."""
    levels = [base]
    while max(levels[-1].shape[:2]) > 1:
        last = levels[-1]
        last = jnp.pad(last, ((0, last.shape[0] % 2), (0, last.shape[1] % 2), (0, 0)), mode="edge")
        rows, columns = last.shape[0] // 2, last.shape[1] // 2
        levels.append(last.reshape(rows, 2, columns, 2, 4).mean(axis=(1, 3)))
    return levels


def _moments(layers: Layers) -> Float[Array, "rows columns 4"]:
    """`_at_samples`, averaged over the square of samples of each pixel, of the margin as well."""
    edge, whole = layers.grid.supersampling, _at_samples(layers)
    apart = [whole[down::edge, across::edge] for down in range(edge) for across in range(edge)]
    return functools.reduce(jnp.add, apart) / edge**2


def _at_samples(layers: Layers) -> Float[Array, "h w 4"]:
    """Means of what a ray through each sample's centre sees: of the radiance, and of its square.

    It stops at a surface of partial opacity with that chance.
    """
    if layers.samples.gloss is None and layers.samples.opacity is None:
        return by_rows(layers, _at_first_samples)
    radiance = radiance_from_centre(layers)
    return by_rows(layers, lambda rows: _through_samples(rows, radiance))


def _at_first_samples(rows: RowsOfLayers) -> Float[Array, "r w 4"]:
    """Of layers that nothing can be seen through."""
    planes = [rows.spread(plane, 0.0, depth=1)[0] for plane in rows.layers.samples.radiance.T]
    held = (rows.cells[0] > 0)[..., None]
    return jnp.where(held, _with_square(jnp.stack(planes, axis=-1)), _far(rows))


def _through_samples(rows: RowsOfLayers, radiance: Float[Array, "n 3"]) -> Float[Array, "r w 4"]:
    """Of layers whose samples have this `radiance`, as the lens centre sees it."""
    opacity, far = rows.layers.samples.opacity, _far(rows)
    shares = rows.cells > 0 if opacity is None else rows.spread(opacity, 0.0)
    moments, through = jnp.zeros_like(far), jnp.ones(far.shape[:2], dtype=far.dtype)
    for colour, share in zip(rows.spread(radiance, 0.0), shares, strict=True):
        moments += (through * share)[..., None] * _with_square(colour)
        through = through * (1 - share)
    return moments + through[..., None] * far


def _far(rows: RowsOfLayers) -> Float[Array, "r w 4"]:
    """Of the background."""
    return _with_square(jnp.broadcast_to(rows.background, (*rows.cells.shape[1:], 3)))


def _with_square(radiance: Float[Array, "r w 3"]) -> Float[Array, "r w 4"]:
    return jnp.concatenate([radiance, (radiance**2).sum(axis=-1, keepdims=True)], axis=-1)


def _box(
    layers: Layers,
    lens: AbstractLens,
    pixel_filter: str,
    film: Float[Array, "2"],
    least: Float[Array, ""],
    largest: Float[Array, ""],
) -> tuple[Float[Array, "2"], Float[Array, "2"], Float[Array, ""]]:
    """Corners, in pixels from that of the grid, of a box around all places that rays of a square pass.

    And the least radius of blur there, of those at `least`, `largest` and midway between them. The square has
    its middle at `film`, and its rays meet disparities from `least` to `largest`.
    """
    wide = filter_radius(pixel_filter) + 0.5 * (EDGE - 1)
    margin = layers.grid.margin / layers.grid.supersampling
    ends = [lens.footprint(layers.camera, film, disparity) for disparity in (least, largest)]
    low = jnp.minimum(*(centre - radius for centre, radius in ends)) - wide
    high = jnp.maximum(*(centre + radius for centre, radius in ends)) + wide
    _, between = lens.footprint(layers.camera, film, 0.5 * (least + largest))
    return low + margin, high + margin, jnp.minimum(between, jnp.minimum(*(end[1] for end in ends)))
