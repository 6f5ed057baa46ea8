"""Where rays of a film point have to be aimed to cross the stop of a real lens at a given place.

For a film point h from the axis let s be a place of the stop in its radii, r along the film point's side and
t across. Rays that cross there are aimed at the point

    X_r = sum c_ij r^i t^j, j even,        X_t = sum c_ij r^i t^j, j odd,        i + j <= 5,

of the last vertex plane, as lenses are mirror images of themselves: the map is smooth, whatever rims cut off.
Its coefficients are fitted by least squares to traced rays. So rays may be drawn with the light of an opening
of any shape, and each stands for the area |dX / ds| around it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.lens._length import Pair
from focusjax.lens._pupils import Pupils, way_from_film
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
        last = self.radial.shape[0] - 1
        low = jnp.clip(jnp.floor(place), 0, last - 1).astype(int)
        share = jnp.clip(place - low, 0.0, 1.0)
        radial, tangential = (
            table[low] + share * (table[low + 1] - table[low]) for table in (self.radial, self.tangential)
        )

        def aim(r: Float[Array, ""], t: Float[Array, ""]) -> Pair:
            powers = [[jnp.ones_like(x)] for x in (r, t)]
            for _ in range(_DEGREE):
                for x, found in zip((r, t), powers, strict=True):
                    found.append(found[-1] * x)

            def total(coefficients: Array, terms: tuple[tuple[int, int], ...]) -> Array:
                return sum(
                    (coefficients[n] * powers[0][i] * powers[1][j] for n, (i, j) in enumerate(terms)),
                    jnp.zeros_like(r),
                )

            return total(radial, _RADIAL), total(tangential, _TANGENTIAL)

        one, none = jnp.ones_like(r), jnp.zeros_like(r)
        aimed, by_r = jax.jvp(aim, (r, t), (one, none))
        _, by_t = jax.jvp(aim, (r, t), (none, one))
        return aimed, jnp.abs(by_r[0] * by_t[1] - by_r[1] * by_t[0])


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
