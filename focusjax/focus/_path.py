"""Where the search over all frames starts: paths through the good answers of each frame by itself.

A wish that leaves its side open has good answers on both sides of the focus. Taken one by one, frames may
choose now this one, now that; the cheapest path through them all, which pays for its jumps, does not
(Viterbi's algorithm).

What a jump costs in the end depends on how far the answers give way, so there is a path for each of several
prices. And where smoothness is dear, the best for all frames may be no frame's own best, but that of a frame
nearby: answers are candidates in the frames around, too.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._joint import Joint
from focusjax.focus._nearest import nearest
from focusjax.focus._objective import Objective
from focusjax.focus._search import starts, walks

PRICES = ((1.0, 0), (1.0, 2), (0.1, 2), (10.0, 2), (1e3, 2))
"""For each path the price of jumps, and over how many frames before and after answers are candidates."""

MOST_ANSWERS = 12
"""Answers of a frame by itself that paths may take."""

_APART_PX = 1e-3
"""Answers that change the picture by less count as one."""


class Answers(eqx.Module):
    """Good answers of a frame by itself, one for each start; of a shot with a leading axis t.

    Attributes:
        values: the parameters.
        cost: what each costs, among equals a little more for what changes the picture more.
        sides: on which the wishes were assumed at the start.
    """

    values: Float[Array, "*t s k"]
    cost: Float[Array, "*t s"]
    sides: Float[Array, "*t s n"]


def answers_of_each(
    joint: Joint, first: Float[Array, "t k"], boxes: Box, *, many: bool, max_steps: int
) -> Answers:
    """The answers of all frames, each of which has points with weight; arguments as for `search`."""

    def answers(frame: Objective, first: Float[Array, "k"], box: Box) -> Answers:
        values, sides = starts(frame, first, box, many=many)
        walked, _, cost, slack = walks(frame, sides, values, first, box, max_steps)
        found = walked.value
        # Among equals the one that changes the picture least, as for a single picture.
        change = jax.vmap(lambda value: frame.change(value, first))(found)
        rank = jnp.argsort(jnp.argsort(change))
        return Answers(found, (cost + 4.0 * slack * rank) * jnp.sum(frame.points.weight), sides)

    return jax.vmap(answers)(joint.frames, first, boxes)


def paths_through(
    joint: Joint,
    answers: Answers,
    first: Float[Array, "t k"],
    boxes: Box,
    counts: Bool[Array, "t"],
    max_steps: int,
) -> Float[Array, "p t k"]:
    """The cheapest path at each of `PRICES`: parameters of all frames in pixels.

    Of frames that count, as their wishes are their own, it has one good answer each; of others, what is in
    between.
    """
    values, cost, distance = _candidates(joint, answers, boxes, counts)
    pixels = values * joint.scale[:, None]
    # A jump is spread over about (smoothness / weight)^(1/4) frames and costs about as much per px^2.
    toll = jnp.maximum(joint.steadiness / joint.unit, (joint.smoothness / joint.unit) ** 0.25)
    toll = jnp.where(joint.present, toll, 0.0)

    def path(price: float, reach: int) -> Float[Array, "t k"]:
        chosen = cheapest_path(pixels, jnp.where(distance[None] <= reach, cost, jnp.inf), price * toll)
        return jnp.take_along_axis(values, chosen[:, None, None], axis=1)[:, 0]

    def near(
        frame: Objective, best: Float[Array, "k"], first: Float[Array, "k"], box: Box
    ) -> Float[Array, "k"]:
        return nearest(frame, best, frame.natural_side(best), first, box, max_steps)[0]

    # A lone frame has no jumps.
    others = PRICES[1:] if len(values) > 1 else ()
    best = jax.vmap(near)(joint.frames, path(*PRICES[0]), first, boxes)
    paths = jnp.stack([best, *(path(*each) for each in others)])
    return jax.vmap(lambda path: filled(path * joint.scale, counts))(paths)


def _candidates(
    joint: Joint, answers: Answers, boxes: Box, counts: Bool[Array, "t"]
) -> tuple[Float[Array, "t c k"], Float[Array, "t c"], Int[Array, "c"]]:
    """Answers of every frame and of those around it, what each costs here, and how many frames away it is."""
    values, cost = jax.vmap(_different)(joint.frames, answers.values, answers.cost)
    frames, many, _ = values.shape
    last = jnp.sum(joint.present) - 1
    reach = min(max(reach for _, reach in PRICES), frames - 1)

    def lent(shift: int) -> tuple[Float[Array, "t a k"], Float[Array, "t a"]]:
        which = jnp.clip(jnp.arange(frames) + shift, 0, last)

        def costs(frame: Objective, values: Float[Array, "a k"], box: Box) -> tuple[Array, Array]:
            inside = jax.vmap(box.inside)(values)
            paid = jax.vmap(lambda value: frame.cost(value, frame.natural_side(value)))(inside)
            return inside, paid * jnp.sum(frame.points.weight)

        moved = values[which] * (joint.scale[which] / joint.scale)[:, None]
        return jax.vmap(costs)(joint.frames, moved, boxes)

    shifts = [sign * away for away in range(1, reach + 1) for sign in (-1, 1)]
    everything = [(values, cost), *(lent(shift) for shift in shifts)]
    cost = jnp.concatenate([cost for _, cost in everything], axis=1) / joint.unit
    return (
        jnp.concatenate([values for values, _ in everything], axis=1),
        jnp.where(counts[:, None], cost, 0.0),
        jnp.asarray(np.repeat([0, *(abs(shift) for shift in shifts)], many)),
    )


def _different(
    frame: Objective, found: Float[Array, "s k"], cost: Float[Array, "s"]
) -> tuple[Float[Array, "a k"], Float[Array, "a"]]:
    """Answers that differ, the cheapest first, and their costs: infinite where there are no more."""
    order = jnp.argsort(cost)
    found, cost = found[order], cost[order]
    apart = jax.vmap(lambda one: jax.vmap(lambda other: frame.change(one, other))(found))(found)
    earlier = np.tri(len(found), k=-1, dtype=bool)
    cost = jnp.where(jnp.any((apart < _APART_PX) & earlier, axis=1), jnp.inf, cost)
    first = jnp.argsort(cost)[:MOST_ANSWERS]
    return found[first], cost[first]


def cheapest_path(
    places: Float[Array, "t s k"], cost: Float[Array, "t s"], toll: Float[Array, "t"]
) -> Int[Array, "t"]:
    """Which of the places to be at in every frame: the least sum of costs and of toll x (jump to it)^2."""

    def arrive(
        so_far: Float[Array, "s"], frame: tuple[Array, Array, Array, Array]
    ) -> tuple[Float[Array, "s"], Int[Array, "s"]]:
        before, here, cost, toll = frame
        jumps = jnp.sum((here[:, None] - before[None]) ** 2, axis=-1)
        total = so_far[None] + toll * jumps
        return cost + jnp.min(total, axis=1), jnp.argmin(total, axis=1)

    total, came_from = jax.lax.scan(arrive, cost[0], (places[:-1], places[1:], cost[1:], toll[1:]))

    def back(at: Int[Array, ""], came_from: Int[Array, "s"]) -> tuple[Array, Array]:
        return came_from[at], came_from[at]

    last = jnp.argmin(total)
    _, earlier = jax.lax.scan(back, last, came_from, reverse=True)
    return jnp.concatenate([earlier, last[None]])


def filled(values: Float[Array, "t k"], known: Bool[Array, "t"]) -> Float[Array, "t k"]:
    """Values between known frames on the line that joins them, and held at the ends."""
    frame = jnp.arange(values.shape[0])
    before = jax.lax.cummax(jnp.where(known, frame, -1))
    after = jax.lax.cummin(jnp.where(known, frame, values.shape[0]), reverse=True)
    left, right = jnp.where(before < 0, after, before), jnp.where(after == values.shape[0], before, after)
    share = (frame - left) / jnp.maximum(right - left, 1)
    return values[left] + share.astype(values.dtype)[:, None] * (values[right] - values[left])
