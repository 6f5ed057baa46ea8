"""Least-distance programming: the point of a convex polytope that is nearest to a goal."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

_STEPS = 40

_CENTRED = 0.1
"""Share of the complementarity that a step leaves."""

_INSIDE = 0.99
"""Share of the way to the nearest boundary that a step takes at most."""


class _Iterate(eqx.Module):
    """Primal and dual variables, the slack of the constraints, and steps taken."""

    point: Float[Array, "k"]
    slack: Float[Array, "r"]
    dual: Float[Array, "r"]
    steps: Int[Array, ""]


def least_distance(
    goal: Float[Array, "k"], rows: Float[Array, "r k"], room: Float[Array, "r"]
) -> Float[Array, "k"]:
    """The x that minimises |x - goal|^2 subject to `rows` @ x <= `room`, for `room` >= 0.

    The origin is feasible, so there always is one. A primal-dual interior-point method: Newton steps on the
    perturbed optimality conditions (Nocedal and Wright, Numerical Optimization, section 16.6). Rows are
    scaled to length 1; rows of zeros are ignored.

    Args:
        goal: where to go.
        rows: normals of the constraints; at least one.
        room: the largest product with each.

    Example:
        >>> least_distance(jnp.array([3.0, 1.0]), jnp.array([[2.0, 0.0]]), jnp.array([4.0])).round(3).tolist()
        [2.0, 1.0]
    """
    length = jnp.linalg.norm(rows, axis=1)
    real = length > 0.0
    safe = jnp.where(real, length, 1.0)
    size = jnp.maximum(jnp.linalg.norm(goal), jnp.finfo(goal.dtype).tiny)
    rows = rows / safe[:, None]
    # In units of the distance to the goal, beyond which no constraint matters.
    goal, room = goal / size, jnp.where(real, jnp.minimum(room / safe / size, 2.0), 2.0)
    count = jnp.maximum(jnp.sum(real), 1)
    arrived = 16.0 * jnp.finfo(goal.dtype).eps

    def gap(state: _Iterate) -> Float[Array, ""]:
        return jnp.sum(jnp.where(real, state.slack * state.dual, 0.0)) / count

    def unmet(state: _Iterate) -> Float[Array, "r"]:
        return rows @ state.point + state.slack - room

    def more(state: _Iterate) -> Array:
        return (state.steps < _STEPS) & (
            (gap(state) > arrived**2) | (jnp.max(jnp.abs(unmet(state))) > arrived)
        )

    def step(state: _Iterate) -> _Iterate:
        slack, dual = state.slack, state.dual
        missed = unmet(state)
        centre = slack * dual - _CENTRED * gap(state)
        weight = jnp.where(real, dual / slack, 0.0)
        right = goal - state.point - rows.T @ jnp.where(real, dual + (dual * missed - centre) / slack, 0.0)
        matrix = jnp.eye(goal.size, dtype=goal.dtype) + rows.T @ (weight[:, None] * rows)
        move = jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(matrix), right)
        by_slack = -missed - rows @ move
        by_dual = jnp.where(real, -(centre + dual * by_slack) / slack, 0.0)

        def longest(at: Float[Array, "r"], by: Float[Array, "r"]) -> Float[Array, ""]:
            return jnp.min(jnp.where(real & (by < 0.0), -at / jnp.where(by < 0.0, by, -1.0), jnp.inf))

        share = jnp.minimum(1.0, _INSIDE * jnp.minimum(longest(slack, by_slack), longest(dual, by_dual)))
        # Beyond what rounding allows there is no step.
        share = jnp.where(jnp.all(jnp.isfinite(move)), share, 0.0)
        point, slack, dual = (
            jnp.where(share > 0.0, at + share * by, at)
            for at, by in ((state.point, move), (slack, by_slack), (dual, by_dual))
        )
        return _Iterate(point, slack, dual, jnp.where(share > 0.0, state.steps + 1, _STEPS))

    ones = jnp.ones_like(room)
    start = _Iterate(jnp.zeros_like(goal), ones, jnp.where(real, ones, 0.0), jnp.array(0))
    return size * jax.lax.while_loop(more, step, start).point
