"""Of all equally good solutions, the one that changes the picture least.

For given sides every error is a convex function of (E, E n), aperture radius times plane. So all minimisers
share their errors, and form a convex set: wishes for values keep their blur, limits are not missed by more
than they are, bounds hold. The nearest minimiser is found by sequential quadratic programming: each step
goes to the nearest place of the linearised set, which for steps in (E, E n) is the set itself.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._image_points import AT_LEAST, AT_MOST
from focusjax.focus._least_distance import least_distance
from focusjax.focus._objective import Objective, with_slopes
from focusjax.focus._parameters import RADIUS
from focusjax.focus._walk import PLANE, has_products, walk, with_products

_MOST_STEPS = 12

_ARRIVED_PX = 1e-5
"""A step that changes the picture by no more is the last."""


def nearest(
    objective: Objective,
    value: Float[Array, "k"],
    side: Float[Array, "n"],
    first: Float[Array, "k"],
    box: Box,
    max_steps: int,
) -> tuple[Float[Array, "k"], Float[Array, "n"]]:
    """Of the solutions around `value` that are as good the one nearest to `first`, in pixels, and its sides.

    Where errors are not linear in what is free a step may leave the set of solutions; a walk leads back.
    """
    cost, slack = objective.cost_and_slack(value, side)

    def round_(start: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
        value, side = start
        back = step_back(objective, value, side, first, box, _MOST_STEPS)
        again = walk(objective, side, back, box, max_steps).value
        natural = objective.natural_side(again)
        least, rounding = objective.cost_and_slack(again, natural)
        good = least - rounding <= cost + slack
        return (jnp.where(good, again, value), jnp.where(good, natural, side)), None

    (value, side), _ = jax.lax.scan(round_, (value, side), length=2)
    return value, side


class _Back(eqx.Module):
    """Where the way back is, and how it goes on.

    Attributes:
        value: free parameters.
        cost: there.
        slack: what of it can be rounding.
        share: of the next step that is taken.
        arrived: whether it is there.
        steps: so far.
    """

    value: Float[Array, "k"]
    cost: Float[Array, ""]
    slack: Float[Array, ""]
    share: Float[Array, ""]
    arrived: Bool[Array, ""]
    steps: Int[Array, ""]


def step_back(
    objective: Objective,
    value: Float[Array, "k"],
    side: Float[Array, "n"],
    first: Float[Array, "k"],
    box: Box,
    most: int,
) -> Float[Array, "k"]:
    """`value`, moved among the equally good towards `first` by at most `most` steps.

    A step is halved where it does not lead nearer, or makes the cost worse.
    """

    def step(state: _Back) -> _Back:
        value, share = state.value, state.share
        change = share * _to_nearest(objective, value, side, first, box)
        back = box.inside(with_products(value, change, box, objective.columns))
        nearer = objective.change(back, first) <= objective.change(value, first)
        cost, slack = objective.cost_and_slack(back, side)
        nearer &= cost - state.cost <= state.slack + slack
        moved = objective.change(back, value)
        return _Back(
            value=jnp.where(nearer, back, value),
            cost=jnp.where(nearer, cost, state.cost),
            slack=jnp.where(nearer, slack, state.slack),
            share=jnp.where(nearer, jnp.minimum(2.0 * share, 1.0), 0.5 * share),
            arrived=moved <= _ARRIVED_PX,
            steps=state.steps + 1,
        )

    def more(state: _Back) -> Bool[Array, ""]:
        return ~state.arrived & (state.steps < most)

    cost, slack = objective.cost_and_slack(value, side)
    none = _Back(value, cost, slack, jnp.ones((), value.dtype), jnp.array(False), jnp.array(0))
    return jax.lax.while_loop(more, step, none).value


def _to_nearest(
    objective: Objective,
    value: Float[Array, "k"],
    side: Float[Array, "n"],
    first: Float[Array, "k"],
    box: Box,
) -> Float[Array, "k"]:
    """The change of the parameters that leads to the nearest place of the linearised set of solutions."""
    width = box.upper - box.lower
    # Errors, also where a limit allows them.
    excess, slopes = with_slopes(lambda at: objective.excess(at, side), value)
    limit = jnp.zeros_like(objective.points.signed)
    if objective.relation is not None:
        limit = (objective.relation == AT_MOST) | (objective.relation == AT_LEAST)
    kept = jnp.where((objective.counted & ~limit)[:, None], slopes, 0.0)
    kept = jnp.concatenate([kept, jnp.diag(objective.priors.inverse)])
    # In pixels of change: the projection onto what the kept errors leave open.
    open_ = objective.scale[:, None] * width[:, None] * weak_directions(kept * width[None])
    open_ = open_ @ jnp.linalg.pinv(open_)
    rows, room = _bounds(value, box, objective.columns)
    if objective.relation is not None:
        limits, spare = _limits(objective, excess, slopes, width)
        rows, room = jnp.concatenate([rows, limits]), jnp.concatenate([room, spare])
    away = open_ @ (objective.scale * (first - value))
    return open_ @ least_distance(away, (rows / objective.scale[None]) @ open_, room) / objective.scale


def _limits(
    objective: Objective, excess: Float[Array, "n"], slopes: Float[Array, "n k"], width: Float[Array, "k"]
) -> tuple[Float[Array, "r k"], Float[Array, "r"]]:
    """Rows a and rooms b >= 0 of a @ change <= b: no limit is missed more than it is."""
    at_most, at_least = objective.relation == AT_MOST, objective.relation == AT_LEAST
    felt = jnp.linalg.norm(slopes * width[None], axis=1) >= UNDETERMINED_PX
    above = jnp.where(at_least, -1.0, 1.0)
    one = jnp.where((felt & objective.counted & (at_most | at_least))[:, None], above[:, None] * slopes, 0.0)
    # |blur| <= t is blur <= t and -blur <= t.
    two = jnp.where((felt & objective.counted & at_most & ~objective.points.signed)[:, None], -slopes, 0.0)
    room = jnp.concatenate([-above * excess, excess + 2.0 * objective.points.target])
    rows = jnp.concatenate([one, two])
    return rows, jnp.where(jnp.any(rows != 0.0, axis=1), jnp.maximum(room, 0.0), 1.0)


def _bounds(
    value: Float[Array, "k"], box: Box, columns: tuple[int, ...]
) -> tuple[Float[Array, "r k"], Float[Array, "r"]]:
    """The same for the bounds of the box, after a change that is linear in (E, E n).

    With E' = E + dE and E' n' = E n + E dn + n dE, n' <= u is dn - (u - n) / E dE <= u - n.
    """
    ends = jnp.concatenate([box.upper - value, value - box.lower])
    signs = jnp.concatenate([jnp.ones_like(value), -jnp.ones_like(value)])
    rows = signs[:, None] * jnp.concatenate([jnp.eye(value.size, dtype=value.dtype)] * 2)
    if has_products(columns):
        products = np.isin(columns, PLANE)
        which = columns.index(RADIUS)
        safe = jnp.where(value[which] > 0.0, value[which], 1.0)
        carried = jnp.where(np.tile(products, 2), ends / safe, 0.0)
        rows = rows - carried[:, None] * np.eye(value.size, dtype=rows.dtype)[which][None]
    return rows, jnp.maximum(ends, 0.0)


def weak_directions(rows: Float[Array, "m k"]) -> Float[Array, "k k"]:
    """Projection onto what changes no row by as much as `UNDETERMINED_PX`, for slopes over whole ranges."""
    _, strength, directions = jnp.linalg.svd(rows, full_matrices=False)
    weak = jnp.where(strength < UNDETERMINED_PX, 1.0, 0.0)
    return (directions.T * weak[None]) @ directions
