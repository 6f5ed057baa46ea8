"""When each ray of a pixel is, where it starts, and which rays are in which span of time."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax.geometry import film_offsets
from focusjax.lens import AbstractLens
from focusjax.trace._groups import RayGroups, groups_of
from focusjax.trace._samples import RaySamples, pixel_chances, pixel_points, tile_edge

_TIME, _PUPIL, _PLACE = 1, (2, 3), (0, 4)
"""Of five dimensions: 64 points are spread evenly in each two of them but 2 and 4, which matter little here:
what crosses the aperture from side to side as it crosses the pixel from top to bottom."""


class Timing(eqx.Module):
    """When each ray is: that of the share u of a pixel's light arrives at quantile(u), a row's delay later.

    Attributes:
        quantiles: times [q] at which evenly spaced shares of the light, 0 to 1, have arrived.
        delay: by how much the bottom of the picture is later than its top.
    """

    quantiles: Float[np.ndarray, " q"] | Float[Array, " q"]
    delay: Float[np.ndarray, ""] | Float[Array, ""] = eqx.field(converter=np.asarray)

    def times(self, moment: Float[Array, "*s g"], row: Int[Array, " g"], height: int) -> Float[Array, "*s g"]:
        """When the share `moment` of the light of pixels in some rows has arrived."""
        late = jnp.broadcast_to(self._late(row, height, moment.dtype), moment.shape)
        return interpolated(jnp.asarray(self.quantiles), moment) + late

    def moment(self, time: Float[Array, " n"], row: Int[Array, " n"], height: int) -> Float[Array, " n"]:
        """The share of the light of pixels in some rows that has arrived at a time: `times` the other way."""
        quantiles = jnp.asarray(self.quantiles)
        shares = jnp.linspace(0.0, 1.0, len(quantiles), dtype=time.dtype)
        return jnp.interp(time - self._late(row, height, time.dtype), quantiles, shares)

    def _late(self, row: Int[Array, " n"], height: int, dtype: Any) -> Float[Array, " n"]:
        """By how much rows are later than the middle of the picture."""
        return jnp.asarray(self.delay) * ((row.astype(dtype) + 0.5) / height - 0.5)

    def share_before(self, time: float, height: int) -> Float[np.ndarray, " h"]:
        """The share of the light of each row that has arrived at a time; on the host."""
        delay = self.delay * ((np.arange(height) + 0.5) / height - 0.5)
        shares = np.linspace(0.0, 1.0, len(self.quantiles))
        return np.asarray(np.interp(time - delay, self.quantiles, shares, left=0.0, right=1.0))


def interpolated(nodes: Float[Array, "k *v"], place: Float[Array, "..."]) -> Float[Array, "..."]:
    """Values at places 0 to 1 between evenly spaced nodes, straight between two of them."""
    last = nodes.shape[0] - 1
    if last == 0:
        return jnp.broadcast_to(nodes[0], (*place.shape, *nodes.shape[1:]))
    along = jnp.clip(place, 0.0, 1.0) * last
    before = jnp.minimum(along.astype(jnp.int32), last - 1)
    share = (along - before.astype(along.dtype)).reshape(*place.shape, *(1 for _ in nodes.shape[1:]))
    return nodes[before] + share * (nodes[before + 1] - nodes[before])


def timed_samples(
    lens: AbstractLens, rays: int, seed: UInt[Array, ""], *, with_chances: bool, pixel_filter: str
) -> RaySamples:
    """Samples of which those of a pixel are in the order of their times.

    Their moments are one in each of as many equal parts of [0, 1) as a pixel has rays.
    """
    edge = tile_edge(rays)
    points = jnp.stack(pixel_points(5, edge, (rays,), seed[None]), axis=-1).reshape(edge**2, rays, 5)
    order = jnp.argsort(points[..., _TIME], axis=1)
    points = jnp.take_along_axis(points, order[..., None], axis=1)
    number = jnp.arange(rays, dtype=points.dtype)
    moment = (number[None] + points[..., _TIME] * rays % 1.0) / rays
    columns = points.reshape(-1, points.shape[-1]).T
    pupil = jax.vmap(lens.pupil_point)(jnp.stack([columns[k] for k in _PUPIL], axis=-1))
    x, y = (film_offsets(pixel_filter, columns[k]) for k in _PLACE)
    return RaySamples(
        place=(x, y),
        pupil=(pupil[:, 0], pupil[:, 1]),
        chance=pixel_chances(edge, rays, seed).reshape(-1) if with_chances else None,
        moment=jnp.minimum(moment, 1.0 - 2.0**-24).reshape(-1),
        edge=edge,
        per_pixel=rays,
    )


class RowShares(eqx.Module):
    """Which rays of the pixels of each row are in a span of time; made on the host.

    Attributes:
        low: share of the light [h] that arrives before the span.
        high: share that arrives before its end; infinite if all does.
        begin: number [h] of the first ray, in the order of times, that may be in it.
        parts: groups [h] of the rays from there on, until none may be in it.
    """

    low: Float[np.ndarray, " h"] | Float[Array, " h"]
    high: Float[np.ndarray, " h"] | Float[Array, " h"]
    begin: Int[np.ndarray, " h"] | Int[Array, " h"]
    parts: Int[np.ndarray, " h"] | Int[Array, " h"]

    def hold(self, moment: Float[Array, "s g"], row: Int[Array, " g"]) -> Bool[Array, "s g"]:
        """Whether rays of pixels in some rows are in the span."""
        return (moment >= self.low[row][None]) & (moment < self.high[row][None])


def row_shares(
    timing: Timing, begin: float | None, end: float | None, height: int, rays: int, together: int
) -> RowShares:
    """The rays from one time, if it is not the first, to another, if it is not the last."""
    low = np.zeros(height) if begin is None else timing.share_before(begin, height)
    high = np.ones(height) if end is None else timing.share_before(end, height)
    # What rounding adds to a whole number of rays is none.
    first = np.floor(low * rays + 1e-6).astype(np.int32)
    last = np.where(high > low, np.ceil(high * rays - 1e-6), first).astype(np.int32)
    return RowShares(low, np.where(high < 1, high, np.inf), first, -(-(last - first) // together))


def timed_groups(
    shares: RowShares, changing: Bool[Array, " p"], width: int, rays: int, together: int, *, most: int
) -> RayGroups:
    """Groups of rays, one after the other in time, of the pixels that are `changing`, `most` in all."""
    height = len(shares.parts)
    parts = jnp.repeat(jnp.asarray(shares.parts), width, total_repeat_length=width * height)
    groups = groups_of(jnp.where(changing, together * parts, 0), width, height, together, most=most)
    first = groups.first + jnp.asarray(shares.begin).at[groups.pixel // width].get(mode="clip")
    return dataclasses.replace(groups, first=first, share=jnp.full_like(groups.share, 1.0 / rays))
