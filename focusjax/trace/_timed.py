"""When each ray of a pixel is, and where it starts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt

from focusjax.geometry import film_offsets
from focusjax.lens import AbstractLens
from focusjax.trace._samples import chances, spread_points, tile_edge

_TIME, _PUPIL, _PLACE = 1, (2, 3), (0, 4)
"""Of five dimensions: 64 points are spread evenly in each two of them but 2 and 4, which matter little here:
what crosses the opening from side to side as it crosses the pixel from top to bottom."""


class Timing(eqx.Module):
    """When each ray is: that of the share u of a pixel's light arrives at quantile(u), a row's delay later.

    Attributes:
        quantiles: times [q] at which evenly spaced shares of the light, 0 to 1, have arrived.
        delay: by how much the bottom of the picture is later than its top.
    """

    quantiles: Float[np.ndarray, " q"]
    delay: float

    def of_row(self, row: np.ndarray, height: int) -> np.ndarray:
        """The delay of rows of the picture; none in its middle."""
        return self.delay * ((row + 0.5) / height - 0.5)

    def share_before(self, time: float, row: np.ndarray, height: int) -> np.ndarray:
        """The share of the light of some rows that has arrived at a time."""
        shares = np.linspace(0.0, 1.0, len(self.quantiles))
        return np.interp(time - self.of_row(row, height), self.quantiles, shares, left=0.0, right=1.0)


class TimedSamples(eqx.Module):
    """Ray starts for the pixels of a tile, those of a pixel in the order of their times; see `RaySamples`."""

    offset: Float[Array, "t s 2"]
    pupil: Float[Array, "t s 2"]
    moment: Float[Array, "t s"]
    chance: UInt[Array, "t s"] | None
    edge: int = eqx.field(static=True)


def timed_samples(
    lens: AbstractLens, rays: int, seed: int, *, with_chances: bool, pixel_filter: str
) -> TimedSamples:
    """Samples whose shares of time [0, 1) are one in each of as many equal parts as a pixel has rays."""
    edge = tile_edge(rays)
    points = spread_points(5, edge, rays, seed)
    order = np.argsort(points[..., _TIME], axis=1)
    points = np.take_along_axis(points, order[..., None], axis=1)
    moment = (np.arange(rays) + points[..., _TIME] * rays % 1.0) / rays
    real = jnp.zeros(()).dtype
    return TimedSamples(
        offset=jnp.asarray(film_offsets(pixel_filter, points[..., _PLACE]), dtype=real),
        pupil=eqx.filter_jit(_pupil_points)(lens, jnp.asarray(points[..., _PUPIL], dtype=real)),
        moment=jnp.asarray(np.minimum(moment, 1.0 - 2.0**-24), dtype=real),
        chance=jnp.asarray(chances(edge, rays, seed)) if with_chances else None,
        edge=edge,
    )


def _pupil_points(lens: AbstractLens, square: Float[Array, "t s 2"]) -> Float[Array, "t s 2"]:
    return jax.vmap(jax.vmap(lens.pupil_point))(square)
