"""How many rays each pixel gets: many where what they may meet differs, few where it is all alike.

With n well-spread rays of variance V a pixel's mean has a squared error of about V / n^a, a between 1 (at
silhouettes) and 2 (where all is smooth). For a given number of rays over the picture the sum of errors is
least when n is in proportion to V^(1 / (1 + a)); in between lies

    n ~ V^0.4.

V is bounded before any ray is traced, by the variance of what the lens centre sees over the box that holds
all places the pixel's rays can pass (Lee10 section 3.1 finds the disparities they can meet, the lens tells
how far they stray there): a summed-area table of radiance and of its square answers for any box. Where the
mean is brighter than white, 1, the variance relative to it counts, as an eye or a film would have it.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.geometry import filter_radius
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._gloss import radiance_from_centre

FEWEST = 4
"""Rays of a pixel where nothing differs. All counts are this times a power of two."""
_MOST_TIMES_MEAN = 8


def counts_for(rays: float) -> list[int]:
    """All numbers of rays that a pixel may get where the mean is `rays`, increasing."""
    return [FEWEST << k for k in range(int(_MOST_TIMES_MEAN * rays // FEWEST).bit_length())]


_EXPONENT = 0.4
_PASSING = 0.8
"""The share of the opening from which on the fewest rays are enough; of half of it, so are twice as many."""
_MOST_DARK = 4
"""Part of the mean that a pixel gets at most for being dark."""
_BINS = 64
"""Per octave of rays, in which pixels are counted."""


def allot(variance: Float[np.ndarray, " p"], rays: float) -> Int[np.ndarray, " p"]:
    """Rays for pixels of a given variance: `rays` of them a pixel on the average, which are four or more."""
    most = len(counts_for(rays)) - 1
    # In octaves above the fewest; a pixel of no variance at all is as far below as one can be.
    octave = _EXPONENT * np.log2(np.maximum(variance, 1e-30))
    first = float(octave.min())
    number = np.minimum(((octave - first) * _BINS).astype(np.int64), 1 << 16)
    pixels = np.bincount(number)
    centre = first + (np.arange(len(pixels)) + 0.5) / _BINS

    def counts_at(shift: float) -> Int[np.ndarray, " b"]:
        return FEWEST << np.clip(np.round(centre + shift), 0, most).astype(np.int64)

    low, high = -float(centre[-1]) - 1.0, most - first + 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if float(counts_at(middle) @ pixels) > float(rays) * len(variance):
            high = middle
        else:
            low = middle
    return counts_at(low)[number]


def allot_through(
    variance: Float[np.ndarray, " p"], light: Float[np.ndarray, " p"], rays: float
) -> Int[np.ndarray, " p"]:
    """As `allot`, with so many for each pixel that some get through a lens that lets pass a share of `light`.

    However plain a pixel is, rays that are all cut off tell nothing of it. But where it is nearly dark little
    is missed, so that it gets a quarter of the mean at most for that.
    """
    most = max(int(rays / _MOST_DARK // FEWEST).bit_length() - 1, 0)
    octave = np.ceil(np.log2(_PASSING / np.maximum(light, 1e-9)))
    least = np.where(light > 0, FEWEST << np.clip(octave, 0, most).astype(np.int64), FEWEST)
    beyond = np.maximum(least - allot(variance, rays), 0).mean()
    return np.maximum(allot(variance, max(rays - beyond, FEWEST)), least)


def contrast(
    layers: Layers,
    lens: AbstractLens,
    least: Float[Array, " p"],
    largest: Float[Array, " p"],
    pixel_filter: str = "box",
) -> Float[np.ndarray, " p"]:
    """Variance of what the lens centre sees, all channels together, around each pixel.

    Over the box that holds its rays between the disparities `least` and `largest`, each pixel's own, from all
    film points of its filter. The weights of rays add none, as the light that gets through a lens is known.
    """
    grid, edge = layers.grid, layers.grid.supersampling
    rows, columns = grid.rows // edge, grid.columns // edge
    table = np.zeros((rows + 1, columns + 1, 4))
    table[1:, 1:] = _moments(layers)
    np.cumsum(np.cumsum(table, axis=0, out=table), axis=1, out=table)
    table = table.reshape(-1, 4)
    low, high = (np.asarray(a) for a in _boxes(layers, lens, least, largest, pixel_filter))
    size = np.array([columns, rows])
    first = np.clip(np.floor(low), 0, size - 1).astype(np.intp)
    last = np.clip(np.ceil(high), first + 1, size).astype(np.intp)

    def at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.take(table, y * (columns + 1) + x, axis=0)

    (left, top), (right, bottom) = first.T, last.T
    total = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top)
    mean = total / ((right - left) * (bottom - top))[:, None]
    white = np.maximum(mean[:, :3].max(axis=1), 1.0)
    square = (mean[:, :3] ** 2).sum(axis=1)
    return np.maximum(mean[:, 3] - square, 0.0) / white**2


@eqx.filter_jit
def _moments(layers: Layers) -> Float[Array, "rows columns 4"]:
    """`_at_samples`, averaged over the square of samples of each pixel, of the margin as well."""
    edge, whole = layers.grid.supersampling, _at_samples(layers)
    apart = [whole[down::edge, across::edge] for down in range(edge) for across in range(edge)]
    return functools.reduce(jnp.add, apart) / edge**2


def _at_samples(layers: Layers) -> Float[Array, "h w 4"]:
    """Means of what a ray through each sample's centre brings: of the radiance, and of its square.

    It stops at a surface of which only a share is there with that chance.
    """
    shape, opacity = layers.cells.shape[1:], layers.opacity

    def with_square(radiance: Float[Array, "h w 3"]) -> Float[Array, "h w 4"]:
        return jnp.concatenate([radiance, (radiance**2).sum(axis=-1, keepdims=True)], axis=-1)

    far = with_square(jnp.broadcast_to(layers.background, (*shape, 3)))
    if layers.samples.gloss is not None or opacity is not None:
        radiance = radiance_from_centre(layers)
        shares = layers.cells > 0 if opacity is None else opacity
        moments, through = jnp.zeros_like(far), jnp.ones(shape, dtype=far.dtype)
        for colour, share in zip(radiance, shares, strict=True):
            moments += (through * share)[..., None] * with_square(colour)
            through = through * (1 - share)
        return moments + through[..., None] * far
    number = layers.places.number(jnp.arange(layers.cells[0].size, dtype=jnp.int32)).reshape(shape)
    planes = [layers.samples.radiance[:, k][number] for k in range(3)]
    return jnp.where((layers.cells[0] > 0)[..., None], with_square(jnp.stack(planes, axis=-1)), far)


@eqx.filter_jit
def _boxes(
    layers: Layers,
    lens: AbstractLens,
    least: Float[Array, " p"],
    largest: Float[Array, " p"],
    pixel_filter: str,
) -> tuple[Float[Array, "p 2"], Float[Array, "p 2"]]:
    """Corners, in pixels from that of the grid, of boxes around all places that each pixel's rays pass."""
    camera, grid, wide = layers.camera, layers.grid, filter_radius(pixel_filter)

    def one(index: Int[Array, ""], least: Array, largest: Array) -> tuple[Array, Array]:
        film = jnp.stack([index % camera.width, index // camera.width]).astype(least.dtype) + 0.5
        ends = [lens.footprint(camera, film, disparity) for disparity in (least, largest)]
        low, high = (
            sum_([centre + sign * (radius + wide) for centre, radius in ends])
            for sign, sum_ in ((-1.0, lambda a: jnp.minimum(*a)), (1.0, lambda a: jnp.maximum(*a)))
        )
        margin = grid.margin / grid.supersampling
        return low + margin, high + margin

    return jax.vmap(one)(jnp.arange(camera.width * camera.height), least, largest)
