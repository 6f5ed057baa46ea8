"""Where in its pixel and where on the lens each ray starts.

Rays of one pixel share one scrambled Sobol block in four dimensions, so that they are spread evenly over
pixel and lens together; of few rays the lens has the first two, in which few points are spread best (3 dB at
eight rays; from sixteen on the pixel's place has them, for 0.2 to 1 dB). Pixels of a square tile take
consecutive blocks of one sequence along a Z-order curve: any 2^k pixels that are neighbours on it are well
spread together too, which moves the error to high frequencies (Ahmed and Wonka 2020).
"""

import functools
import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt
from scipy.stats import qmc

from focusjax.geometry import film_offsets
from focusjax.lens import AbstractLens

_MOST_SAMPLES = 1 << 20
_ENOUGH_FOR_FOUR = 16
"""Points that are spread evenly in each two of four dimensions."""
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


class RaySamples(eqx.Module):
    """Ray starts for the pixels of a tile that repeats over the picture, for different numbers of rays.

    Attributes:
        offset: position in the pixel [t, s, 2], 0 to 1 in x and y, or beyond as far as its filter reaches;
            the rays of the fewest a pixel may have, then those of the next number, and so on.
        pupil: point of the opening [t, s, 2] in units of the aperture radius.
        chance: 32 bits [t, s] that decide where a ray stops among surfaces that are there in part only;
            None where nothing is. Those of one pixel are evenly spaced, in an order that spreads them
            evenly over its first rays, too.
        edge: edge of the tile in pixels (static).
    """

    offset: Float[Array, "t s 2"]
    pupil: Float[Array, "t s 2"]
    chance: UInt[Array, "t s"] | None
    edge: int = eqx.field(static=True)

    def of_pixel(
        self, column: Int[Array, ""], row: Int[Array, ""], first: Int[Array, ""], count: int
    ) -> tuple[Float[Array, "s 2"], Float[Array, "s 2"], UInt[Array, " s"] | None]:
        """Pixel offsets, pupil points and chances of the `count` rays from `first` on of one pixel."""
        tile = (row % self.edge) * self.edge + column % self.edge
        start, size = (tile, first, 0), (1, count, 2)
        chance = self.chance
        return (
            jax.lax.dynamic_slice(self.offset, start, size)[0],
            jax.lax.dynamic_slice(self.pupil, start, size)[0],
            None if chance is None else jax.lax.dynamic_slice(chance, start[:2], size[:2])[0],
        )


def ray_samples(
    lens: AbstractLens,
    counts: Sequence[int],
    seed: int,
    *,
    with_chances: bool = False,
    pixel_filter: str = "box",
    independent: bool = False,
) -> RaySamples:
    """Samples through `lens` for pixels with each of the increasing `counts` of rays, fixed by `seed`.

    Their places in the pixel have the density of `pixel_filter`. `with_chances` says whether there is
    anything that lets rays through. Scrambled sequences share what is coarse about them, but for a few random
    bits, so that the noise of pictures of two seeds may go together by half; that of `independent` starts, in
    which each pixel of the tile has a shift of its own, does not.
    """
    edge = tile_edge(counts[-1])
    points = np.concatenate([_starts(edge, count, seed) for count in counts], axis=1)
    if independent:
        shift = np.random.default_rng(seed).random((edge**2, 1, 4))
        points = np.minimum((points + shift) % 1.0, 1.0 - 2.0**-24).astype(np.float32)
    chance = None
    if with_chances:
        chance = jnp.asarray(np.concatenate([chances(edge, count, seed) for count in counts], axis=1))
    real = jnp.zeros(()).dtype
    offset, square = points[..., :2], jnp.asarray(points[..., 2:], dtype=real)
    return RaySamples(
        offset=jnp.asarray(film_offsets(pixel_filter, offset), dtype=real),
        pupil=eqx.filter_jit(_pupil_points)(lens, square),
        chance=chance,
        edge=edge,
    )


def tile_edge(rays: int) -> int:
    """Edge in pixels of the tile that repeats over the picture, for so many rays a pixel."""
    edge = 32
    while edge > 1 and rays * edge**2 > _MOST_SAMPLES:
        edge //= 2
    return edge


@functools.lru_cache(maxsize=12)
def spread_points(dimensions: int, edge: int, rays: int, seed: int) -> Float[np.ndarray, "t s d"]:
    """Points of the unit cube, some for each pixel of a tile, below 1 also in single precision."""
    length = edge**2 * rays
    sequence = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(max(length - 1, 0).bit_length())[:length]
    points = np.minimum(points, 1.0 - 2.0**-24).astype(np.float32)
    return points.reshape(edge**2, rays, dimensions)[_places(edge)]


@functools.lru_cache(maxsize=12)
def line_points(edge: int, rays: int, seed: int) -> Float[np.ndarray, "k j s 3"]:
    """Points of the unit cube for `edge` lines of as many unit intervals each, some for every interval.

    Those of a line are spread evenly over all of it, and so are those of each part: the first coordinate
    advances from each to the next by the line's length over their number, on the average.
    """
    length = edge**2 * rays
    sequence = qmc.Sobol(3, scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(max(length - 1, 0).bit_length())[:length].reshape(edge, edge * rays, 3)
    points = np.take_along_axis(points, np.argsort(points[..., :1], axis=1), axis=1)
    strata = edge * rays
    points[..., 0] = (points[..., 0] * strata % 1.0 + np.arange(strata) % rays) / rays
    return np.minimum(points.reshape(edge, edge, rays, 3), 1.0 - 2.0**-24).astype(np.float32)


def chances(edge: int, rays: int, seed: int) -> UInt[np.ndarray, "t s"]:
    """32 bits [t, s] that lie evenly for the rays of each pixel of a tile."""
    leap = next(k for k in range(round(_GOLDEN * rays), 2 * rays + 2) if math.gcd(k, rays) == 1)
    of_ray = np.arange(rays) * leap % rays / rays
    of_pixel = (_places(edge) * _GOLDEN + np.random.default_rng(seed).random())[:, None]
    return ((of_ray + of_pixel) % 1.0 * 2.0**32).astype(np.uint32)


def _starts(edge: int, rays: int, seed: int) -> Float[np.ndarray, "t s 4"]:
    points = spread_points(4, edge, rays, seed)
    return points[..., [2, 3, 0, 1]] if rays < _ENOUGH_FOR_FOUR else points


def _places(edge: int) -> Int[np.ndarray, " t"]:
    """Position of each pixel of a tile along the Z-order curve, row-major."""
    rows, columns = np.divmod(np.arange(edge**2), edge)
    return z_order(columns, rows)


def _pupil_points(lens: AbstractLens, square: Float[Array, "t s 2"]) -> Float[Array, "t s 2"]:
    return jax.vmap(jax.vmap(lens.pupil_point))(square)


def z_order(column: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Position of each pixel along the Z-order (Morton) curve."""
    out = np.zeros_like(column)
    for bit in range(16):
        out |= ((column >> bit) & 1) << (2 * bit) | ((row >> bit) & 1) << (2 * bit + 1)
    return out
