"""Where in its pixel and where on the lens each ray starts.

The rays of one pixel are a block of one scrambled Sobol sequence in four dimensions, so that they are spread
evenly over pixel and lens together. The lens has the first two dimensions, in which few points are spread
best. Pixels of a square tile take consecutive blocks along a Z-order curve: any 2^k pixels that are
neighbours on it are well spread together, too, which moves the error to high frequencies (Ahmed and Wonka
2020). The tile repeats over the picture.
"""

import math
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._whole import taken
from focusjax.geometry import film_offsets
from focusjax.lens import AbstractLens
from focusjax.trace._sobol import shuffled, sobol_points, stirred

_MOST_SAMPLES = 1 << 20
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_CHANCE, _ORDER = 64, 65
"""Numbers of the seed's streams for chances and the order of pixels, after those of dimensions."""
_Whole = TypeVar("_Whole", np.ndarray, Array)


class RaySamples(eqx.Module):
    """Ray starts for the pixels of a tile, for pixels with different numbers of rays.

    Those of a pixel with the fewest rays come first, then those of a pixel with the next number, and so on.

    Attributes:
        place: x and y in the pixel, each [t * s], 0 to 1 from its left and top border, or beyond as far as
            the pixel filter reaches.
        pupil: x and y on the aperture, each [t * s], in aperture radii.
        chance: 32 bits [t * s] that decide where a ray stops among surfaces of partial opacity; None where
            there are none.
        moment: share of its pixel's light [t * s], 0 to 1, that arrives before the ray; None where nothing
            moves.
        edge: edge of the tile in pixels (static).
        per_pixel: s, rays of all numbers together (static).
    """

    place: tuple[Float[Array, " n"], Float[Array, " n"]]
    pupil: tuple[Float[Array, " n"], Float[Array, " n"]]
    chance: UInt[Array, " n"] | None
    moment: Float[Array, " n"] | None
    edge: int = eqx.field(static=True)
    per_pixel: int = eqx.field(static=True)

    def at(self, column: Int[Array, "*n"], row: Int[Array, "*n"], number: Int[Array, "*n"]) -> "Starts":
        """Ray `number` of the pixel in `column` and `row`, element by element."""
        # The edge is a power of two.
        last = self.edge - 1
        index = ((row & last) * self.edge + (column & last)) * self.per_pixel + number

        def look(plane: Array) -> Array:
            return taken(plane, index)

        x, y = (look(plane) for plane in self.place)
        u, v = (look(plane) for plane in self.pupil)
        chance, moment = (None if plane is None else look(plane) for plane in (self.chance, self.moment))
        return Starts(column.astype(x.dtype) + x, row.astype(y.dtype) + y, u, v, chance, moment)


class Starts(eqx.Module):
    """Some rays, each [*n]: film points in pixels, aperture points in aperture radii, chances, moments."""

    x: Float[Array, "*n"]
    y: Float[Array, "*n"]
    u: Float[Array, "*n"]
    v: Float[Array, "*n"]
    chance: UInt[Array, "*n"] | None
    moment: Float[Array, "*n"] | None = None


def ray_samples(
    lens: AbstractLens,
    counts: tuple[int, ...],
    seed: UInt[Array, ""],
    *,
    with_chances: bool = False,
    pixel_filter: str = "box",
    edge: int | None = None,
) -> RaySamples:
    """Samples through `lens` for pixels with each of the increasing `counts` of rays, chosen by `seed`.

    Places in the pixel have the density of `pixel_filter`. `with_chances` says whether anything has a partial
    opacity. Samples of different seeds are independent. `edge` is that of the tile in pixels, a power of two;
    as large as its table may be if not given.
    """
    edge = tile_edge(counts[-1]) if edge is None else min(edge, tile_edge(counts[-1]))
    u, v, x, y = pixel_points(4, edge, counts, jnp.stack([stirred(seed, k) for k in range(len(counts))]))
    pupil = jax.vmap(lens.pupil_point)(jnp.stack([u, v], axis=-1))
    chance = None
    if with_chances:
        levels = [pixel_chances(edge, count, stirred(seed, k)) for k, count in enumerate(counts)]
        chance = jnp.concatenate(levels, axis=1).reshape(-1)
    return RaySamples(
        place=(film_offsets(pixel_filter, x), film_offsets(pixel_filter, y)),
        pupil=(pupil[:, 0], pupil[:, 1]),
        chance=chance,
        moment=None,
        edge=edge,
        per_pixel=sum(counts),
    )


def pixel_points(
    dimensions: int, edge: int, counts: tuple[int, ...], seeds: UInt[Array, " k"]
) -> list[Float[Array, " n"]]:
    """Coordinates [t * s] of points of the unit hypercube, some for each pixel of a tile.

    They are spread evenly over each pixel and over all, for pixels with each of the `counts` of them in turn,
    each number by a seed of its own. All are one program: several would take longer to compile.

    Which pixel has which block of the sequence is chosen by the seed, too: scrambling alone leaves what is
    coarse about a block, but for few random bits, so that the noise of two seeds would go together.
    """
    order = z_order(*reversed(np.divmod(np.arange(edge**2), edge))).astype(np.int32)
    order = shuffled(jnp.asarray(order)[:, None], edge**2, stirred(seeds, _ORDER)[None])
    level = np.repeat(np.arange(len(counts)), counts)
    number = np.concatenate([np.arange(count, dtype=np.int32) for count in counts])
    index = order[:, level] * jnp.asarray(counts, dtype=jnp.int32)[level][None] + number[None]
    points = sobol_points(index, seeds[level][None], dimensions, most=edge**2 * counts[-1])
    return [coordinate.reshape(-1) for coordinate in points]


def pixel_chances(edge: int, rays: int, seed: UInt[Array, ""]) -> UInt[Array, "t s"]:
    """32 bits [t, s] evenly spaced for the rays of each pixel of a tile, its first rays among them evenly."""
    order = z_order(*reversed(np.divmod(np.arange(edge**2), edge)))
    leap = next(k for k in range(round(_GOLDEN * rays), 2 * rays + 2) if math.gcd(k, rays) == 1)
    # In whole numbers: those of later surfaces are multiples of these, and so would be their rounding.
    of_ray = np.arange(rays) * leap % rays * 2**32 // rays
    of_pixel = np.floor(order * _GOLDEN % 1.0 * 2.0**32).astype(np.int64)[:, None]
    spaced = ((of_ray + of_pixel) % 2**32).astype(np.uint32)
    return jnp.asarray(spaced) + stirred(seed, _CHANCE)


def line_points(edge: int, rays: int, seed: UInt[Array, ""]) -> Float[Array, "k j s 3"]:
    """Points of the unit cube for `edge` lines of as many unit intervals each, some for every interval.

    Those of a line are spread evenly over all of it, and so are those of each part: the first coordinate
    advances from each to the next by the line's length over their number, on the average.
    """
    strata = edge * rays
    index = jnp.arange(edge * strata, dtype=jnp.int32)
    points = jnp.stack(sobol_points(index, seed, 3, most=edge * strata), axis=-1).reshape(edge, strata, 3)
    order = jnp.argsort(points[..., :1], axis=1)
    points = jnp.take_along_axis(points, order, axis=1)
    within = jnp.arange(strata, dtype=jnp.int32) % rays
    along = (points[..., 0] * strata % 1.0 + within.astype(points.dtype)[None]) / rays
    along = jnp.minimum(along, 1.0 - 2.0**-24)
    return points.at[..., 0].set(along).reshape(edge, edge, rays, 3)


def tile_edge(rays: int) -> int:
    """Edge in pixels of the tile that repeats over the picture, for so many rays a pixel."""
    edge = 32
    while edge > 1 and rays * edge**2 > _MOST_SAMPLES:
        edge //= 2
    return edge


def z_order(column: _Whole, row: _Whole, *, bits: int = 16) -> _Whole:
    """Position of each pixel along the Z-order (Morton) curve, of `bits` of its column and row."""
    out = 0 * column
    for bit in range(bits):
        out |= ((column >> bit) & 1) << (2 * bit) | ((row >> bit) & 1) << (2 * bit + 1)
    return out
