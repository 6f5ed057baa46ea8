"""The basin of the best solution: a fixed list of starts, each walked downhill, and the best of them.

Given sides, the errors are convex in (E, E n), so a walk ends at the best there is for its sides. Of an
upright lens only the order of the points in depth decides which sides can be: every cut between two of them
is a start, up to `MOST_CUTS`, so the best over all starts is the best of all. Of a tilted lens the sides are
those of points and a plane, of which planes parallel to the sensor, a few tilted ones, and the best of those
through triples of the points are tried (`plane_starts`).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._entries import with_entries
from focusjax.focus._bounds import Box
from focusjax.focus._global import nearest_of
from focusjax.focus._image_points import SAME
from focusjax.focus._nearest import nearest, step_back, weak_directions
from focusjax.focus._objective import Objective
from focusjax.focus._parameters import FOCUS, SWING, TILT
from focusjax.focus._plane_starts import plane_starts
from focusjax.focus._walk import Walk, walk

MOST_CUTS = 16
"""Depths at which starts of an upright lens cut the points in two."""

MOST_TILTED_CUTS = 8
"""The same for each of several planes, when tilt or swing is free."""

_STEPS_OF_EACH = 2
"""Steps from the end of every walk towards the lens as given, among what is equally good."""

_ALIGNED = 1e-6
"""Squared sine of the angle below which an open direction is a parameter's own."""


class Basin(eqx.Module):
    """Where the best solution is, and the smooth problem that it solves there.

    Attributes:
        value: free parameters.
        side: for every point, the factor (1 or -1) of its blur in its error.
        on: points whose wish holds the solution; the others are limits kept with room to spare.
        at_lower: parameters that a lower bound keeps from a better value.
        at_upper: the same for upper bounds.
        held: parameters that the wishes leave open, whatever the others do.
        open: projection [k, k], in parameters over their ranges, onto other directions left open.
        settled: whether the walk came to rest.
        steps: steps of the walk.
    """

    value: Float[Array, "k"]
    side: Float[Array, "n"]
    on: Bool[Array, "n"]
    at_lower: Bool[Array, "k"]
    at_upper: Bool[Array, "k"]
    held: Bool[Array, "k"]
    open: Float[Array, "k k"]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]


def search(objective: Objective, first: Float[Array, "k"], box: Box, *, many: bool, max_steps: int) -> Basin:
    """The best solution over all starts.

    Of several that are equally good to within rounding the one is taken that changes the picture least, and
    of two that change it as much the one of nearest focus. `first` is the lens as given; `many` (static)
    says whether some wishes leave their side open, so that one start may not do. No walk takes more than
    `max_steps`.
    """
    values, sides = starts(objective, first, box, many=many)
    found, natural, cost, slack = walks(objective, sides, values, first, box, max_steps)
    equal = cost - slack <= jnp.min(cost + slack)
    focus = jax.vmap(lambda value: objective.parameters(value)[FOCUS])(found.value)
    chosen = nearest_of(equal, jax.vmap(lambda value: objective.change(value, first))(found.value), focus)
    value, side = nearest(objective, found.value[chosen], natural[chosen], first, box, max_steps)
    at_lower, at_upper = _pushed(objective, value, side, box)
    on = objective.on(value, side)
    held, open_ = _open(objective, value, side, on, ~(at_lower | at_upper), box)
    return Basin(
        value=value,
        side=side,
        on=on,
        at_lower=at_lower,
        at_upper=at_upper,
        held=held,
        open=open_,
        settled=found.settled[chosen],
        steps=found.steps[chosen],
    )


def walks(
    objective: Objective,
    sides: Float[Array, "s n"],
    values: Float[Array, "s k"],
    first: Float[Array, "k"],
    box: Box,
    max_steps: int,
) -> tuple[Walk, Float[Array, "s n"], Float[Array, "s"], Float[Array, "s"]]:
    """Walks from all starts: with the sides on which they end, their costs, and what of these is rounding.

    Every walk is taken a second time, from where the first one ends but with what the wishes leave open
    brought back towards the lens as given, `first`.
    """

    def round_(start: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], tuple[Any, ...]]:
        side, value = start
        found = walk(objective, side, value, box, max_steps)
        natural = objective.natural_side(found.value)
        cost, slack = objective.cost_and_slack(found.value, natural)
        back = step_back(objective, found.value, natural, first, box, _STEPS_OF_EACH)
        return (natural, back), (found, natural, cost, slack)

    def twice(side: Float[Array, "n"], value: Float[Array, "k"]) -> tuple[Walk, Array, Array, Array]:
        # A loop, so that the walk is compiled once.
        _, rounds = jax.lax.scan(round_, (side, value), length=2)
        walked, _, cost, slack = rounds
        back = cost[1] - slack[1] <= cost[0] + slack[0]
        found, natural, cost, slack = jax.tree.map(lambda leaf: jnp.where(back, leaf[1], leaf[0]), rounds)
        return eqx.tree_at(lambda walk: walk.steps, found, jnp.sum(walked.steps)), natural, cost, slack

    return jax.vmap(twice)(sides, values)


def starts(
    objective: Objective, first: Float[Array, "k"], box: Box, *, many: bool
) -> tuple[Float[Array, "s k"], Float[Array, "s n"]]:
    """Values to start from, and the sides to assume for each: the lens as given and, if `many`, others."""
    values, sides = first[None], objective.natural_side(first)[None]
    if many:
        other_values, other_sides = _other_starts(objective, first, box)
        values, sides = jnp.concatenate([values, other_values]), jnp.concatenate([sides, other_sides])
    return values, sides


def _other_starts(
    objective: Objective, first: Float[Array, "k"], box: Box
) -> tuple[Float[Array, "s k"], Float[Array, "s n"]]:
    """Lenses focused and tilted elsewhere, on either side of cuts between the points."""
    columns = objective.columns
    turns = (0.0, 1.0) if FOCUS in columns else np.linspace(0.0, 1.0, MOST_TILTED_CUTS)
    bases = [first]
    for tilt in (TILT, SWING):
        if tilt in columns:
            which = columns.index(tilt)
            ends = [box.lower[which] + share * (box.upper[which] - box.lower[which]) for share in turns]
            bases += [
                with_entries(first, (which,), ((first[which] + end) / 2.0 if FOCUS in columns else end,))
                for end in ends
            ]
    if FOCUS not in columns:
        values = jnp.stack(bases)
        return values, jax.vmap(objective.natural_side)(values)
    which = columns.index(FOCUS)
    size = objective.points.disparity.size * (1 if objective.other is None else 2)
    cuts = min(MOST_CUTS if len(bases) == 1 else MOST_TILTED_CUTS, size)

    def cut(base: Float[Array, "k"], share: Float[Array, ""]) -> tuple[Array, Array]:
        """The base focused between two points, with that share of the open wishes behind the focus."""
        depth = _cut(objective, base, share)
        unbounded = with_entries(base, (which,), (depth,))
        return jnp.clip(unbounded, box.lower, box.upper), objective.natural_side(unbounded)

    shares = jnp.linspace(0.0, 1.0, cuts + 1, dtype=first.dtype)
    values, sides = jax.vmap(jax.vmap(cut, in_axes=(None, 0)), in_axes=(0, None))(jnp.stack(bases), shares)
    values = values.reshape(-1, first.size)
    sides = sides.reshape(-1, objective.points.disparity.shape[0])
    if len(bases) > 1:
        through, divided = plane_starts(objective, first, box)
        values, sides = jnp.concatenate([values, through]), jnp.concatenate([sides, divided])
    return values, sides


def _cut(objective: Objective, base: Float[Array, "k"], share: Float[Array, ""]) -> Float[Array, ""]:
    """The focus disparity in 1/m that has that share of the wishes without a side behind it."""
    parameters = objective.parameters(base)
    changes, pending = objective.own.sharp_at(parameters), objective.two_sided
    if objective.other is not None:
        changes = jnp.concatenate([changes, objective.other.sharp_at(parameters)])
        pending = jnp.concatenate([pending, pending & (objective.relation == SAME)])
    count = jnp.sum(pending)
    ordered = jnp.sort(jnp.where(pending, changes, jnp.inf))
    behind = jnp.round(share * count).astype(int)
    low = ordered[jnp.maximum(behind - 1, 0)]
    high = ordered[jnp.minimum(behind, ordered.size - 1)]
    nearest = jnp.where(count > 0, ordered[jnp.maximum(count - 1, 0)], parameters[FOCUS])
    farthest = jnp.where(count > 0, ordered[0], parameters[FOCUS])
    return jnp.where(
        behind <= 0,
        farthest - 1.0,
        jnp.where(behind >= count, nearest + 1.0, 0.5 * (low + jnp.where(jnp.isfinite(high), high, low))),
    )


def _pushed(
    objective: Objective, value: Float[Array, "k"], side: Float[Array, "n"], box: Box
) -> tuple[Bool[Array, "k"], Bool[Array, "k"]]:
    """Which parameters a bound keeps from a better value: the cost's slope there, beyond rounding."""
    error, slopes = objective.slopes(value, side)
    gradient = (objective.share * error) @ slopes
    gradient += objective.prior_share * objective.priors(value) * objective.priors.inverse
    rounding = (objective.share * objective.noise(value)) @ jnp.abs(slopes)
    down, up = gradient > rounding, gradient < -rounding
    return (value <= box.lower) & down, (value >= box.upper) & up


def _open(
    objective: Objective,
    value: Float[Array, "k"],
    side: Float[Array, "n"],
    on: Bool[Array, "n"],
    moves: Bool[Array, "k"],
    box: Box,
) -> tuple[Bool[Array, "k"], Float[Array, "k k"]]:
    """Parameters, and a projection onto directions, whose whole range changes no wish's blur by much."""
    unit = jnp.where(moves, box.upper - box.lower, 0.0)
    slopes = jax.jacfwd(objective.excess)(value, side)
    slopes = jnp.where((on & objective.counted)[:, None], slopes, 0.0)
    projection = weak_directions(jnp.concatenate([slopes, jnp.diag(objective.priors.inverse)]) * unit[None])
    # The parameter's own axis is open, whatever the others do.
    held = moves & (jnp.diag(projection) > 1.0 - _ALIGNED)
    mixed = moves & ~held
    return held, jnp.where(mixed[:, None] & mixed[None], projection, 0.0)
