"""Where the search over all frames starts: a way through the good answers of each frame by itself.

A wish that leaves its side open has good answers on both sides of the focus. Taken one by one, frames may
choose now this one, now that; the cheapest way through them all, which pays for its jumps, does not
(Viterbi's algorithm).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._joint import Joint
from focusjax.focus._nearest import nearest
from focusjax.focus._objective import Objective
from focusjax.focus._search import starts, walks


def way_through(
    joint: Joint,
    first: Float[Array, "t k"],
    boxes: Box,
    counts: Bool[Array, "t"],
    *,
    many: bool,
    max_steps: int,
) -> Float[Array, "t k"]:
    """Parameters in pixels: of frames with wishes, one of their good answers each; of others, in between.

    Args:
        joint: the whole problem; every frame of it has points with weight, and `counts` says whose they are.
        first: the lens as given, in the parameters of each frame.
        boxes: bounds on these.
        counts: frames whose wishes are their own.
        many: whether some wishes leave their side open (static).
        max_steps: steps allowed to each walk (static).
    """

    def answers(
        frame: Objective, first: Float[Array, "k"], box: Box
    ) -> tuple[Float[Array, "s k"], Float[Array, "s"]]:
        values, sides = starts(frame, first, box, many=many)
        walked, _, cost, slack = walks(frame, sides, values, first, box, max_steps)
        found = walked.value
        # Among equals the one that changes the picture least, as for a single picture.
        change = jax.vmap(lambda value: frame.change(value, first))(found)
        rank = jnp.argsort(jnp.argsort(change))
        return found, (cost + 4.0 * slack * rank) * jnp.sum(frame.points.weight)

    values, cost = jax.vmap(answers)(joint.frames, first, boxes)
    pixels = values * joint.scale[:, None]
    cost = jnp.where(counts[:, None], cost / joint.unit, 0.0)
    # A jump is spread over about (smoothness / weight)^(1/4) frames and costs about as much per px^2.
    share = joint.smoothness / joint.unit
    chosen = cheapest_way(pixels, cost, jnp.maximum(joint.steadiness / joint.unit, share**0.25))
    best = jnp.take_along_axis(values, chosen[:, None, None], axis=1)[:, 0]

    def near(
        frame: Objective, best: Float[Array, "k"], first: Float[Array, "k"], box: Box
    ) -> Float[Array, "k"]:
        return nearest(frame, best, frame.natural_side(best), first, box, max_steps)[0]

    best = jax.vmap(near)(joint.frames, best, first, boxes)
    return _filled(best * joint.scale, counts)


def cheapest_way(
    places: Float[Array, "t s k"], cost: Float[Array, "t s"], toll: Float[Array, ""]
) -> Int[Array, "t"]:
    """Which of the places to be at in every frame: the least sum of costs and of toll x (jump)^2."""

    def arrive(
        so_far: Float[Array, "s"], frame: tuple[Array, Array, Array]
    ) -> tuple[Float[Array, "s"], Int[Array, "s"]]:
        before, here, cost = frame
        jumps = jnp.sum((here[:, None] - before[None]) ** 2, axis=-1)
        total = so_far[None] + toll * jumps
        return cost + jnp.min(total, axis=1), jnp.argmin(total, axis=1)

    total, came_from = jax.lax.scan(arrive, cost[0], (places[:-1], places[1:], cost[1:]))

    def back(at: Int[Array, ""], came_from: Int[Array, "s"]) -> tuple[Array, Array]:
        return came_from[at], came_from[at]

    last = jnp.argmin(total)
    _, earlier = jax.lax.scan(back, last, came_from, reverse=True)
    return jnp.concatenate([earlier, last[None]])


def _filled(values: Float[Array, "t k"], known: Bool[Array, "t"]) -> Float[Array, "t k"]:
    """Values between known frames on the line that joins them, and held at the ends."""
    frame = jnp.arange(values.shape[0])
    before = jax.lax.cummax(jnp.where(known, frame, -1))
    after = jax.lax.cummin(jnp.where(known, frame, values.shape[0]), reverse=True)
    left, right = jnp.where(before < 0, after, before), jnp.where(after == values.shape[0], before, after)
    share = (frame - left) / jnp.maximum(right - left, 1)
    return values[left] + share.astype(values.dtype)[:, None] * (values[right] - values[left])
