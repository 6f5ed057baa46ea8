"""Bounds on the rays of each film point of a lens whose film points are alike in no direction.

As `_ray_bounds`, over a grid of film points: in tangents of the view all rays of a film point lie, at the
disparity w, within A + B |w - w_0| of a + b w, with vectors a and b.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.lens._length import root
from focusjax.lens._ray_bounds import MARGIN, ROUNDING, disk_of_rays

_CELLS = 16
"""Of the grid, along either side of the frame."""

Rays = tuple[Float[Array, "r 2"], Float[Array, "r 2"], Float[Array, " r"], Float[Array, " r"]]
"""Slopes, crossings of the pupil in metres, light, and the areas of the opening that rays stand for."""


class RayDisk(eqx.Module):
    """Disks around the rays of film points; any number of axes may come before.

    Attributes:
        at_infinity: a, tangents x to the right and y upwards [2].
        crossing: b, metres [2].
        focus: w_0, 1/m.
        spot: A, tangent.
        spread: B, metres.
        radius: metres; of the round opening whose blur has the same variance.
    """

    at_infinity: Float[Array, "*k 2"]
    crossing: Float[Array, "*k 2"]
    focus: Float[Array, "*k"]
    spot: Float[Array, "*k"]
    spread: Float[Array, "*k"]
    radius: Float[Array, "*k"]


class FilmBounds(eqx.Module):
    """Disks around the rays of film points over a grid of them, in tangents x to the right and y upwards.

    Attributes:
        corner: tangents [2] of the first film point.
        step: tangents [2] from one to the next.
        disks: [k, k], the first axis along x.
    """

    corner: Float[Array, "2"]
    step: Float[Array, "2"]
    disks: RayDisk

    def at(self, tangents: Float[Array, "2"]) -> RayDisk:
        """Interpolated between the film points around one."""
        place = jnp.clip((tangents - self.corner) / self.step, 0.0, _CELLS)
        low = jnp.clip(jnp.floor(place), 0, _CELLS - 1).astype(int)
        (x, y), (i, j) = place - low, low

        def between(table: Array) -> Array:
            first = table[i, j] + y * (table[i, j + 1] - table[i, j])
            second = table[i + 1, j] + y * (table[i + 1, j + 1] - table[i + 1, j])
            return first + x * (second - first)

        return jax.tree.map(between, self.disks)

    def reach(self, disparity: Float[Array, ""]) -> Float[Array, ""]:
        """The farthest tangent from its film point that any ray has at a disparity."""
        disks = self.disks
        strays = _size(disks.at_infinity + disks.crossing * disparity - self._tangents())
        return jnp.max(strays + disks.spot + disks.spread * jnp.abs(disparity - disks.focus))

    def parallax(self) -> Float[Array, ""]:
        """The farthest in metres from the middle of the pupil that any ray crosses its plane."""
        return jnp.max(_size(self.disks.crossing) + self.disks.spread)

    def _tangents(self) -> Float[Array, "k k 2"]:
        steps = jnp.arange(_CELLS + 1, dtype=self.step.dtype)
        x, y = (self.corner[axis] + self.step[axis] * steps for axis in range(2))
        return jnp.stack(jnp.meshgrid(x, y, indexing="ij"), axis=-1)


def find_film_bounds(
    rays: Callable[[Float[Array, "2"]], Rays], corner: Float[Array, "2"], far: Float[Array, "2"]
) -> FilmBounds:
    """Disks around the rays of film points from one corner of the frame to the other.

    Film points in the middles of cells are traced, too: twice what they exceed the interpolated disks by is
    added around them, and a share for what lies between rays.

    `rays` are those of the film point at given tangents; `corner` and `far` are the least and the largest.
    """
    step = (far - corner) / _CELLS

    def over(cells: int, first: float) -> tuple[Array, ...]:
        places = first + jnp.arange(cells, dtype=step.dtype)
        grid = jnp.stack(jnp.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
        tangents = corner[None] + step[None] * grid

        def one(seen: Array) -> tuple[Array, ...]:
            slope, crossing, light, area = rays(seen)
            *found, lit = disk_of_rays(slope, crossing, light, area)
            return (jnp.where(lit, found[0], seen), *found[1:])

        return tuple(leaf.reshape(cells, cells, *leaf.shape[1:]) for leaf in jax.lax.map(one, tangents))

    kept, between = RayDisk(*over(_CELLS + 1, 0.0)), RayDisk(*over(_CELLS, 0.5))
    guess = jax.tree.map(_of_cells, kept)
    b_off = between.crossing - guess.crossing
    a_off = between.at_infinity - guess.at_infinity + b_off * guess.focus[..., None]
    spot = _size(a_off) + jnp.maximum(between.spot - guess.spot, 0.0)
    spot = spot + between.spread * jnp.abs(between.focus - guess.focus)
    spread = _size(b_off) + jnp.maximum(between.spread - guess.spread, 0.0)
    kept = eqx.tree_at(
        lambda disks: (disks.spot, disks.spread),
        kept,
        (
            MARGIN * kept.spot + 2.0 * _around(spot) + ROUNDING,
            MARGIN * kept.spread + 2.0 * _around(spread),
        ),
    )
    return FilmBounds(corner, step, kept)


def _of_cells(table: Float[Array, "k k *c"]) -> Array:
    """Means of the four corners of each cell."""
    return 0.25 * (table[:-1, :-1] + table[1:, :-1] + table[:-1, 1:] + table[1:, 1:])


def _around(excess: Float[Array, "c c"]) -> Array:
    """The most of the cells around each corner."""
    padded = jnp.pad(excess, 1)
    return jnp.maximum(
        jnp.maximum(padded[:-1, :-1], padded[1:, :-1]), jnp.maximum(padded[:-1, 1:], padded[1:, 1:])
    )


def _size(vector: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
    return root(jnp.sum(vector**2, axis=-1))
