"""Where the search of a tilted lens starts: planes through the places of wishes, as view cameras are set.

On which side of the plane in focus wishes lie is all that makes a problem of a tilted lens hard: for given
sides it is convex. Two planes that divide the places alike can be moved into one another until they pass
through three of the places (two, where only tilt or swing is free), so that planes through triples of them,
with each of the three on either side, stand for all ways to divide them (Edelsbrunner, Algorithms in
Combinatorial Geometry, 1987, on arrangements). For each the errors are linear in (E, E n), and their least
squares without bounds show which are worth a walk.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._entries import with_entries
from focusjax.focus._bounds import Box
from focusjax.focus._image_points import AT_LEAST, AT_MOST, BLUR, SAME
from focusjax.focus._objective import Objective
from focusjax.focus._parameters import FOCUS, RADIUS, SWING, TILT, ZOOM, BlurModel

_PLACES = 9
"""Places of which planes go through triples; of more, these are spread over their distances."""

_WALKS = 16
"""The most divisions that are walked from."""

_LIMIT_WEIGHT = 0.1
"""Weight of a limit, relative to a wish for a blur, in the choice of the divisions to walk from."""


def plane_starts(
    objective: Objective, first: Float[Array, "k"], box: Box
) -> tuple[Float[Array, "s k"], Float[Array, "s n"]]:
    """Values to start from, and the sides of all rows for each: the best ways to divide the wishes.

    Focus, and tilt or swing, are free.
    """
    columns = objective.columns
    turns = tuple(each for each in (TILT, SWING) if each in columns)
    rows, across, disparity = _places(objective)
    free = [each - TILT for each in turns]
    parameters = objective.parameters(first)
    fixed = jnp.where(np.isin([TILT, SWING], turns), 0.0, objective.own.tangents(parameters))
    level = disparity - across @ fixed
    matrix = jnp.stack([jnp.ones_like(level), *(across[:, each] for each in free)], axis=1)
    size = len(turns) + 1
    tuples = np.array(list(itertools.combinations(range(_PLACES), size)))
    flips = np.array(list(itertools.product((1.0, -1.0), repeat=size)))

    def through(chosen: Int[Array, " m"]) -> Float[Array, "f n"]:
        """Sides of all rows for the plane through some places, with these on either side."""
        a, b = matrix[chosen], level[chosen]
        ridge = jnp.finfo(b.dtype).eps * jnp.eye(size, dtype=b.dtype)
        plane = jnp.linalg.solve(a.T @ a + ridge, a.T @ b)
        focus, *slopes = plane
        places = [columns.index(each) for each in (FOCUS, *turns)]
        value = with_entries(first, places, [focus, *(each * parameters[ZOOM] for each in slopes)])
        side = objective.natural_side(value)
        mine = objective.two_sided[rows[chosen]]

        def flipped(flip: Float[Array, " m"]) -> Float[Array, "n"]:
            return side.at[rows[chosen]].set(jnp.where(mine, flip, side[rows[chosen]]))

        return jax.vmap(flipped)(jnp.asarray(flips, dtype=side.dtype))

    sides = jax.vmap(through)(jnp.asarray(tuples)).reshape(-1, objective.points.disparity.shape[0])
    values = jax.vmap(lambda side: _best_unbounded(objective, side, first, box, turns))(sides)
    naturals = jax.vmap(objective.natural_side)(values)
    cost = jax.vmap(objective.cost)(values, naturals)
    best, order = jax.lax.top_k(-jnp.where(jnp.isfinite(cost), cost, jnp.inf), 8 * _WALKS)
    # Of those that are the same, one.
    new = jnp.concatenate([jnp.ones(1, dtype=bool), jnp.abs(jnp.diff(best)) > 1e-6 * (1.0 - best[1:])])
    kept = order[jnp.argsort(~new, stable=True)[:_WALKS]]
    return values[kept], naturals[kept]


def _places(objective: Objective) -> tuple[Int[Array, " p"], Float[Array, "p 2"], Float[Array, " p"]]:
    """Rows, view tangents and disparities of places whose side is open, spread over their distances."""
    own, pending = objective.own, objective.two_sided
    assert own.across is not None
    rows, across, disparity = jnp.arange(own.disparity.size), own.across, own.disparity
    if objective.other is not None:
        other = objective.other
        assert other.across is not None
        rows = jnp.concatenate([rows, rows])
        across = jnp.concatenate([across, other.across])
        disparity = jnp.concatenate([disparity, other.disparity])
        pending = jnp.concatenate([pending, pending & (objective.relation == SAME)])
    # Those that are pending first, in order of distance; without any, some place or other.
    order = jnp.argsort(jnp.where(pending, disparity, jnp.inf))
    count = jnp.maximum(jnp.sum(pending), 1)
    number = jnp.arange(_PLACES)
    spread = jnp.where(count > _PLACES, (number * count) // _PLACES, jnp.minimum(number, count - 1))
    chosen = order[spread]
    return rows[chosen], across[chosen], disparity[chosen]


def _best_unbounded(
    objective: Objective, side: Float[Array, "n"], first: Float[Array, "k"], box: Box, turns: tuple[int, ...]
) -> Float[Array, "k"]:
    """Least squares for given sides, in the products (E, E u, E n), cut off at the bounds."""
    columns, points = objective.columns, objective.points
    opens = RADIUS in columns
    start = objective.parameters(first)
    zoom = start[ZOOM]

    def products(unknown: Float[Array, " m"]) -> tuple[Array, Array, Array]:
        """Radius, focus disparity times it, and slopes up and to the right times it."""
        radius, rest = (unknown[0], unknown[1:]) if opens else (start[RADIUS], unknown)
        slopes = radius * jnp.stack(start[TILT : SWING + 1])
        return radius, rest[0], with_entries(slopes, [each - TILT for each in turns], rest[1:])

    def miss(unknown: Float[Array, " m"]) -> Float[Array, "n"]:
        radius, focus, slopes = products(unknown)

        def blur(model: BlurModel) -> Float[Array, "n"]:
            assert model.across is not None
            tilted = model.across @ (slopes / zoom)
            gain = model.gain if model.power is None else model.gain * zoom**model.power
            return gain * (focus + tilted - radius * model.disparity)

        off = side * blur(objective.own) - points.target
        if objective.other is not None:
            off = off - jnp.where(objective.relation == SAME, blur(objective.other), 0.0)
        return off

    weight = objective.share
    if objective.relation is not None:
        limit = (objective.relation == AT_MOST) | (objective.relation == AT_LEAST)
        weight = jnp.where(limit, _LIMIT_WEIGHT * weight, weight)
    if points.quantity is not None:
        weight = jnp.where(points.quantity == BLUR, weight, 0.0)
    none = jnp.zeros(1 + len(turns) + opens, first.dtype)
    matrix = jax.jacfwd(miss)(none)
    weighted = matrix * weight[:, None]
    normal = weighted.T @ matrix
    size = jnp.sqrt(jnp.maximum(jnp.diag(normal), jnp.finfo(first.dtype).tiny))
    ridge = 16.0 * jnp.finfo(first.dtype).eps * jnp.eye(none.size, dtype=first.dtype)
    found = jnp.linalg.solve(normal / jnp.outer(size, size) + ridge, -(weighted.T @ miss(none)) / size) / size
    radius, focus, slopes = products(found)
    radius = jnp.where(radius == 0, jnp.finfo(first.dtype).tiny, radius)
    best = focus / radius, radius, *(slopes / radius), *start[ZOOM:]
    return jnp.clip(jnp.stack([best[column] for column in columns]), box.lower, box.upper)
