"""Where rays of a film point have to be aimed to cross the stop of a real lens at a given place.

For a film point h from the axis let s be a place of the stop in its radii, r along the film point's side and
t across. Rays that cross there are aimed at the point

    X_r = sum c_ij r^i t^j, j even,        X_t = sum c_ij r^i t^j, j odd,        i + j <= 5,

of the last vertex plane, as lenses are mirror images of themselves: the map is smooth, whatever rims cut off.
Its coefficients are fitted by least squares to traced rays. So rays may be drawn with the light of an opening
of any shape, and each stands for the area |dX / ds| around it.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.lens._length import Pair
from focusjax.lens._pupils import Pupils, at_place, way_from_film
from focusjax.optics import BLOCKED, Prescription, trace_path

_DEGREE = 5
_POWERS = tuple((i, j) for j in range(_DEGREE + 1) for i in range(_DEGREE + 1 - j))
_RADIAL = tuple(power for power in _POWERS if power[1] % 2 == 0)
_TANGENTIAL = tuple(power for power in _POWERS if power[1] % 2 == 1)
_RINGS, _TURNS = 8, 13
_RIDGE = 1e-9
"""Of normal equations, for film points that see too little of the stop."""


class StopMap(eqx.Module):
    """Aims for k distances of the film point from the axis.

    Attributes:
        radial: coefficients [k, n] of X_r in mm.
        tangential: those [k, m] of X_t.
    """

    radial: Float[Array, "k n"]
    tangential: Float[Array, "k m"]

    def at(self, place: Float[Array, ""], r: Float[Array, ""], t: Float[Array, ""]) -> tuple[Pair, Array]:
        """X_r, X_t, and mm^2 of them per square radius of the stop, at a `place` counted in film radii."""
        radial, tangential = at_place((self.radial, self.tangential), place)
        # X_r = A_0 + A_2 t^2 + A_4 t^4 and X_t = A_1 t + A_3 t^3 + A_5 t^5, where A_j = sum_i c_ij r^i.
        tables = [iter(radial), iter(tangential)]
        factors = [[next(tables[j % 2]) for _ in range(_DEGREE + 1 - j)] for j in range(_DEGREE + 1)]
        values, slopes = zip(*(_horner(each, r) for each in factors), strict=True)
        q = t * t
        out = _horner(values[0::2], q)
        aside = _horner(values[1::2], q)
        out_by_r, aside_by_r = _horner(slopes[0::2], q)[0], t * _horner(slopes[1::2], q)[0]
        out_by_t, aside_by_t = 2.0 * t * out[1], aside[0] + 2.0 * q * aside[1]
        return (out[0], t * aside[0]), jnp.abs(out_by_r * aside_by_t - aside_by_r * out_by_t)


def _horner(coefficients: Sequence[Array], x: Float[Array, ""]) -> Pair:
    """A polynomial at x, and its derivative there."""
    value, slope = coefficients[-1], jnp.zeros_like(coefficients[-1])
    for number, coefficient in enumerate(coefficients[-2::-1]):
        slope = slope * x + value if number else value
        value = value * x + coefficient
    return value, slope


def find_stop_map(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    film_distance: Float[Array, ""],
    heights: Float[Array, " k"],
    pupils: Pupils,
) -> StopMap:
    """The map for film points at `heights` (mm), whose `pupils` are known. It has derivatives."""
    rings = np.sin(0.5 * np.pi * np.arange(1, _RINGS + 1) / _RINGS)
    turns = np.linspace(0.0, np.pi, _TURNS)
    spots = np.stack([np.outer(rings, np.cos(turns)).ravel(), np.outer(rings, np.sin(turns)).ravel()], axis=1)
    wanted = jnp.asarray(spots, dtype=heights.dtype)

    def one(height: Array, inside: Array) -> tuple[Array, Array]:
        def crossing(target: Array) -> tuple[Array, tuple[Array, Array]]:
            """Where a ray crosses the stop, twice, and its clearance."""
            film = height, jnp.zeros_like(height)
            start = way_from_film(lens, film_distance, film, (target[0], target[1]))
            ray, points = trace_path(lens, indices, *start, backward=True)
            place = points[lens.stop, :2] / lens.semi_diameters[lens.stop]
            return place, (place, ray.clearance)

        # From a ray that passes, straight on: near enough, as it is where rays do cross that counts.
        middle = jnp.stack([inside, jnp.zeros_like(inside)])
        slope, (first, _) = jax.lax.stop_gradient(jax.jacfwd(crossing, has_aux=True)(middle))
        (a, b), (c, d) = slope
        det = a * d - b * c
        safe = jnp.where(det == 0.0, 1.0, det)
        off = wanted - first[None]
        steps = jnp.stack([d * off[:, 0] - b * off[:, 1], a * off[:, 1] - c * off[:, 0]], axis=1) / safe
        targets = middle[None] + steps
        _, (place, clearance) = jax.vmap(crossing)(targets)
        near = jnp.sum(place**2, axis=1) < 2.0
        weight = jnp.where((clearance > 0.5 * BLOCKED) & near, 1.0, 0.0)

        def fit(terms: tuple[tuple[int, int], ...], values: Array) -> Array:
            columns = jnp.stack([place[:, 0] ** i * place[:, 1] ** j for i, j in terms], axis=1)
            weighted = weight[:, None] * columns
            square = weighted.T @ columns + _RIDGE * jnp.eye(len(terms), dtype=columns.dtype)
            return jnp.linalg.solve(square, weighted.T @ values)

        return fit(_RADIAL, targets[:, 0]), fit(_TANGENTIAL, targets[:, 1])

    radial, tangential = jax.vmap(one)(heights, pupils.inside)
    # Where no light comes, as where some comes last.
    nearest = jax.lax.cummax(jnp.where(pupils.open, jnp.arange(heights.shape[0]), 0))
    return StopMap(radial[nearest], tangential[nearest])
