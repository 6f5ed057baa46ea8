"""How deep the rays of a pixel need to look: the disparities found under their footprint."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax._few import largest_of_few, least_of_few
from focusjax._whole import taken
from focusjax.geometry import filter_radius
from focusjax.layers import Layers, RangePyramid
from focusjax.lens import AbstractLens
from focusjax.trace._in_parts import in_parts

_ROUNDS = 4
_SLACK = 1.0
"""Samples."""
EDGE = 2
"""Pixels along the edge of the squares that ranges are found for."""


class DisparityRanges(eqx.Module):
    """What the rays of the pixels of small squares can meet, row-major squares [q].

    Attributes:
        least: least disparity in 1/m.
        largest: largest one; 0 where there is nothing to meet.
        depth: most layers.
        across: squares per row (static).
    """

    least: Float[Array, " q"]
    largest: Float[Array, " q"]
    depth: Int[Array, " q"]
    across: int = eqx.field(static=True)

    def at(
        self, column: Int[Array, "*n"], row: Int[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Int[Array, "*n"]]:
        """Least and largest disparity and number of layers for pixels in a column and row."""
        square = self.square(column, row)
        least, largest, depth = (taken(plane, square) for plane in (self.least, self.largest, self.depth))
        return least, largest, depth

    def square(self, column: Int[Array, "*n"], row: Int[Array, "*n"]) -> Int[Array, "*n"]:
        """Number of the square that the pixels in a column and row lie in."""
        return row // EDGE * self.across + column // EDGE

    def middles(self) -> Float[Array, "q 2"]:
        """Film points in the middle of the squares."""
        row, column = jnp.divmod(jnp.arange(self.least.shape[0], dtype=jnp.int32), self.across)
        return (jnp.stack([column, row], axis=-1).astype(self.least.dtype) + 0.5) * EDGE

    def pixels(self, width: int, height: int) -> Int[Array, " q"]:
        """How many pixels of the picture lie in each square."""
        across, down = (
            jnp.minimum(size - jnp.arange(0, size, EDGE, dtype=jnp.int32), EDGE) for size in (width, height)
        )
        return (down[:, None] * across[None]).reshape(-1)

    def of_pixels(self, width: int, height: int) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        """Least and largest disparity of each pixel, row-major."""
        row, column = jnp.divmod(jnp.arange(width * height, dtype=jnp.int32), width)
        return self.at(column, row)[:2]


def disparity_ranges(layers: Layers, lens: AbstractLens, pixel_filter: str = "box") -> DisparityRanges:
    """The disparities that rays of the pixels of each small square can meet."""
    camera = layers.camera
    across, down = -(-camera.width // EDGE), -(-camera.height // EDGE)
    nothing = jnp.zeros(across * down, dtype=jnp.zeros(()).dtype)
    squares = DisparityRanges(nothing, nothing, jnp.zeros(across * down, dtype=jnp.int32), across)

    def one(x: Float[Array, ""], y: Float[Array, ""]) -> tuple[Array, Array, Array]:
        return disparity_range(
            layers, lens, jnp.stack([x, y]), filter_radius(pixel_filter) + 0.5 * (EDGE - 1)
        )

    x, y = squares.middles().T
    least, largest, depth = in_parts(lambda some: jax.vmap(one)(*some), (x, y))
    return DisparityRanges(least, largest, depth, across)


def disparity_range(
    layers: Layers, lens: AbstractLens, film_point: Float[Array, "2"], wide: float
) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
    """As `narrowed`, for rays of film points up to `wide` pixels from `film_point` along x and y."""
    grid = layers.grid
    # Those of film points between are bounded by those of the corners, but for what the slack makes up for.
    ends = sorted({-wide, wide})
    offsets = jnp.array([(x, y) for y in ends for x in ends], dtype=film_point.dtype)

    def bound(film: Float[Array, "2"], disparity: Float[Array, ""]) -> tuple[Array, Array]:
        """The square on the grid around the footprint of one film point."""
        centre, radius = lens.footprint(layers.camera, film, disparity)
        on_grid, reach = centre * grid.supersampling + grid.margin, radius * grid.supersampling
        return on_grid - reach, on_grid + reach

    def box(least: Float[Array, ""], largest: Float[Array, ""]) -> tuple[Array, Array]:
        ends = jnp.stack([least, largest])
        bounds = jax.vmap(lambda w: jax.vmap(lambda step: bound(film_point + step, w))(offsets))(ends)
        return least_of_few(bounds[0].reshape(-1, 2)), largest_of_few(bounds[1].reshape(-1, 2))

    return narrowed(layers.ranges, box)


def narrowed(
    ranges: RangePyramid, box: Callable[[Float[Array, ""], Float[Array, ""]], tuple[Array, Array]]
) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
    """Least and largest disparity, and layer count, of what is within the box that it gives itself.

    Lee10 section 3.1: bound the footprint for the whole scene, look up the disparities under it, bound again
    for those alone, and so on; a few rounds gain nearly all. The largest is 0 where there is nothing to meet.

    Args:
        ranges: disparities over any square.
        box: the corners [2] in samples of all places at disparities from the least to the largest.
    """

    def narrow(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        low, high = box(*state[:2])
        least, largest, depth = ranges.query(low - _SLACK, high + _SLACK)
        # Where nothing is below, the range is empty: collapse it to infinity.
        empty = largest <= 0
        return jnp.where(empty, 0.0, least), jnp.where(empty, 0.0, largest), depth

    overall = ranges.overall
    start = jnp.where(overall[1] > 0, overall[0], 0.0), overall[1], ranges.most_layers
    return jax.lax.fori_loop(0, _ROUNDS, narrow, start)
