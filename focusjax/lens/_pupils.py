"""Where light gets through a real lens, seen from the film, found by rays.

From a film point h off the axis, the points of the last vertex plane through which rays reach the scene form
a region without holes, symmetric about the meridional plane: a disk for the axis, a cat's eye towards the
corners. The place of the greatest clearance is found by narrowing a search along the meridional line, the
region's rim from there by bisection, and an ellipse around it is what rays are spread over. So few are lost.
"""

from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax.lens._length import Pair
from focusjax.optics import Prescription, RealRay, trace

_Tables = TypeVar("_Tables")

SOFTNESS = 0.02
"""Share of its radius over which a rim goes from open to closed, so that weights have derivatives."""
_ROUNDS, _TRIED = 4, 33
_TURNS = 60
_BISECTIONS = 12
_COVER = 1.02
"""How much larger than needed the ellipse is: film points between those examined have theirs interpolated."""


class Pupils(eqx.Module):
    """The openings that film points see, for k distances of the film point from the axis.

    Attributes:
        centre: mm in the last vertex plane [k], away from the axis on the film point's side.
        radial: half the width in mm of the ellipse along that line [k].
        tangential: half its width across [k].
        inside: mm [k]; a point of the region.
        rim: distance in mm [k, t] from there to the rim, at angles of 0 to pi from the radial line.
        open: whether any light comes through [k]; where none does, the rest is that of the nearest that is
            open.
    """

    centre: Float[Array, " k"]
    radial: Float[Array, " k"]
    tangential: Float[Array, " k"]
    inside: Float[Array, " k"]
    rim: Float[Array, "k t"]
    open: Bool[Array, " k"]


class Turn(NamedTuple):
    """A turn about the axis, after a mirroring across it, by which lenses are seen from all sides."""

    cosine: Float[Array, ""]
    sine: Float[Array, ""]
    side: Float[Array, ""]
    """1, or -1 to mirror."""

    def __call__(self, x: Float[Array, ""], y: Float[Array, ""]) -> Pair:
        """A vector turned."""
        across = self.side * y
        return self.cosine * x - self.sine * across, self.sine * x + self.cosine * across

    def back(self, x: Float[Array, ""], y: Float[Array, ""]) -> Pair:
        """A vector turned back."""
        return self.cosine * x + self.sine * y, self.side * (self.cosine * y - self.sine * x)


def from_film(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    film_distance: Float[Array, ""],
    film: Pair,
    target: Pair,
) -> tuple[RealRay, Float[Array, ""]]:
    """The ray from a film point through a point of the last vertex plane (mm), and its cosine at the film."""
    start, way = way_from_film(lens, film_distance, film, target)
    return trace(lens, indices, start, way, backward=True), -way[2]


def way_from_film(
    lens: Prescription, film_distance: Float[Array, ""], film: Pair, target: Pair
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """A film point (mm from the first vertex) and the unit vector from there to a target, both [3]."""
    x, y = target[0] - film[0], target[1] - film[1]
    inverse = 1.0 / jnp.sqrt(x * x + y * y + film_distance * film_distance)
    start = jnp.stack([film[0], film[1], lens.vertices()[-1] + film_distance])
    return start, jnp.stack([x * inverse, y * inverse, -film_distance * inverse])


def openness(clearance: Float[Array, ""]) -> Float[Array, ""]:
    """1 for rays that pass, 0 for those that do not, linear across a rim."""
    return jnp.clip(0.5 + clearance / SOFTNESS, 0.0, 1.0)


def turns(dtype: jnp.dtype) -> Float[Array, " t"]:
    """The angles at which rims are found, 0 to pi."""
    return jnp.linspace(0.0, jnp.pi, _TURNS + 1, dtype=dtype)


def at_place(tables: _Tables, place: Float[Array, ""]) -> _Tables:
    """Tables over film radii at a `place` counted in steps, linear between them; as at the ends beyond."""
    last = jax.tree.leaves(tables)[0].shape[0] - 1
    place = jnp.clip(place, 0.0, last)
    low = jnp.clip(jnp.floor(place), 0, last - 1).astype(int)
    return jax.tree.map(lambda table: table[low] + (place - low) * (table[low + 1] - table[low]), tables)


def points_of(
    inside: Float[Array, ""], rim: Float[Array, " t"], edges: tuple[float, ...]
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """Points of one half of an opening, along the radial line and across, and the areas that they stand for.

    They are on four rings of equal area, and at shares `edges` of the rim's radius, which stand for none.
    """
    equal = tuple(((ring + 0.5) / 4) ** 0.5 for ring in range(4))
    shares = jnp.asarray((*equal, *edges), dtype=rim.dtype)[:, None]
    rings, angles = shares * rim[None], turns(rim.dtype)[None]
    area = jnp.where(jnp.arange(len(shares))[:, None] < len(equal), rim[None] ** 2, 0.0)
    return (inside + rings * jnp.cos(angles)).ravel(), (rings * jnp.sin(angles)).ravel(), area.ravel()


def find_pupils(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    film_distance: Float[Array, ""],
    heights: Float[Array, " k"],
    turn: Turn | None = None,
) -> Pupils:
    """The openings seen from film points at `heights` (mm, increasing from 0). They carry no derivatives.

    Film points are along the x axis, or where a `turn` takes it.
    """
    turned = (lambda x, y: (x, y)) if turn is None else turn
    lens, indices, film_distance, heights = jax.lax.stop_gradient((lens, indices, film_distance, heights))
    reach = 1.5 * lens.semi_diameters[-1]

    def clearance(height: Array, x: Array, y: Array) -> Array:
        film = turned(height, jnp.zeros_like(height))
        ray, _ = from_film(lens, indices, film_distance, film, turned(x, y))
        return ray.clearance

    def find(height: Array) -> tuple[Array, Array, Array]:
        def narrow(_: Any, span: tuple[Array, Array]) -> tuple[Array, Array]:
            middle, half = span
            tried = middle + half * jnp.linspace(-1.0, 1.0, _TRIED, dtype=half.dtype)
            clear = jax.vmap(lambda x: clearance(height, x, jnp.zeros_like(x)))(tried)
            return tried[jnp.argmax(clear)], half * (2.0 / (_TRIED - 1))

        inside, _ = jax.lax.fori_loop(0, _ROUNDS, narrow, (jnp.zeros_like(reach), reach))
        rim = jax.vmap(lambda turn: edge(height, inside, turn))(turns(inside.dtype))
        return inside, rim, clearance(height, inside, jnp.zeros_like(inside)) > -SOFTNESS / 2

    def edge(height: Array, inside: Array, turn: Array) -> Array:
        def halve(_: Any, span: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = span
            middle = 0.5 * (low + high)
            clear = clearance(height, inside + middle * jnp.cos(turn), middle * jnp.sin(turn))
            passes = clear > -SOFTNESS / 2
            return jnp.where(passes, middle, low), jnp.where(passes, high, middle)

        return jax.lax.fori_loop(0, _BISECTIONS, halve, (jnp.zeros_like(reach), 2.0 * reach))[0]

    inside, rim, is_open = jax.vmap(find)(heights)
    # The last that is open, for all that are not.
    nearest = jax.lax.cummax(jnp.where(is_open, jnp.arange(heights.shape[0]), 0))
    inside, rim = inside[nearest], rim[nearest]
    angles = turns(rim.dtype)[None]
    x, y = inside[:, None] + rim * jnp.cos(angles), rim * jnp.sin(angles)
    centre, radial = 0.5 * (x.max(axis=1) + x.min(axis=1)), 0.5 * (x.max(axis=1) - x.min(axis=1))
    tangential = y.max(axis=1)
    safe_radial, safe_tangential = (jnp.where(r > 0.0, r, 1.0)[:, None] for r in (radial, tangential))
    outside = ((x - centre[:, None]) / safe_radial) ** 2 + (y / safe_tangential) ** 2
    cover = _COVER * jnp.sqrt(outside.max(axis=1))
    return Pupils(centre, cover * radial, cover * tangential, inside, rim, is_open)
