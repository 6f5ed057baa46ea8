"""On which sides of the focus the wishes of all frames are: the likeliest choices, by a beam search.

Given sides, a frame's errors are taken as linear in its parameters (with the focus alone free they are), and
smoothness over time is linear too, so that the least cost of frames up to t is a quadratic function of the
parameters of the last two: that of frame t + 1 follows by adding its errors and smoothness, and by minimising
over the oldest. There are as many such functions as choices of sides up to t. Kept are the `HISTORIES` that
may cost least for every choice in frame t, a Viterbi search whose states remember how they came about.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._image_points import root_weight
from focusjax.focus._joint import Joint
from focusjax.focus._objective import Objective

CHOICES = 12
"""Choices of sides of each frame, those that by themselves cost least."""

HISTORIES = 6
"""Histories kept for each of them."""

TRIED = 3
"""Choices for all frames that walks start from."""

_PULL = 1e-4
"""Weight of a squared px from where errors are taken as linear: what nothing else determines stays there."""

_LEAST_ROOM = 1e-3
"""Pixels between bounds below which a parameter is taken as held."""


class _Quadratic(eqx.Module):
    """x A x / 2 - b x + c as a function of x, for A the matrix, b the slope, and c the rest."""

    matrix: Float[Array, "*a k k"]
    slope: Float[Array, "*a k"]
    rest: Float[Array, "*a"]


def likely_sides(
    joint: Joint, values: Float[Array, "t s k"], sides: Float[Array, "t s n"], counts: Bool[Array, "t"]
) -> tuple[Float[Array, "h t n"], Float[Array, "h t k"]]:
    """The `TRIED` choices of sides in all frames that cost least, and parameters to start from.

    Args:
        joint: the whole problem.
        values: parameters near which errors are taken as linear, for each of several choices of sides.
        sides: these choices, for every frame.
        counts: frames with wishes of their own.
    """

    def choices(
        frame: Objective,
        scale: Float[Array, "k"],
        room: Float[Array, "k"],
        values: Float[Array, "s k"],
        sides: Float[Array, "s n"],
    ) -> tuple[_Quadratic, Int[Array, "c"]]:
        own = jax.vmap(lambda value, side: _own(frame, scale, room, value, side, joint.unit))(values, sides)
        cost = jax.vmap(_least)(own)
        decided = sides * frame.two_sided[None]
        same = jnp.all(decided[:, None] == decided[None], axis=-1)
        cheaper = (cost[None] < cost[:, None]) | (
            (cost[None] == cost[:, None]) & np.tri(len(cost), k=-1, dtype=bool)
        )
        best = jnp.argsort(jnp.where(jnp.any(same & cheaper, axis=1), jnp.inf, cost))[:CHOICES]
        twice = jnp.any((same & cheaper)[best], axis=1)
        own = jax.tree.map(lambda leaf: leaf[best], own)
        return eqx.tree_at(lambda q: q.rest, own, jnp.where(twice, jnp.inf, own.rest)), best

    own, which = jax.vmap(choices)(joint.frames, joint.scale, joint.upper - joint.lower, values, sides)
    own = jax.tree.map(lambda leaf: jnp.where(counts.reshape(-1, *[1] * (leaf.ndim - 1)), leaf, 0.0), own)
    # Frames that fill the shot up have one choice, lest the best differ in nothing else.
    only = jnp.where(jnp.arange(own.rest.shape[1]) > 0, jnp.inf, 0.0)
    own = eqx.tree_at(lambda q: q.rest, own, jnp.where(joint.present[:, None], own.rest, only[None]))
    frame = jnp.arange(len(values))[None]
    chosen = which[frame, _search(own, joint.bend, joint.pace)]
    return sides[frame, chosen], values[frame, chosen]


def _own(
    frame: Objective,
    scale: Float[Array, "k"],
    room: Float[Array, "k"],
    value: Float[Array, "k"],
    side: Float[Array, "n"],
    unit: Float[Array, ""],
) -> _Quadratic:
    """A frame's cost near a value, in pixels of its parameters."""
    root = root_weight(frame.points.weight)
    error, slopes = frame.slopes(value, side)
    rows = jnp.concatenate([root * error, frame.priors(value)]) / jnp.sqrt(unit)
    slopes = jnp.concatenate([root[:, None] * slopes, jnp.diag(frame.priors.inverse)]) / jnp.sqrt(unit)
    slopes = jnp.where(room > _LEAST_ROOM, 1.0 / scale, 0.0)[None] * slopes
    at = value * scale
    wanted = slopes @ at - rows
    pull = _PULL * jnp.eye(at.size, dtype=at.dtype)
    return _Quadratic(
        slopes.T @ slopes + pull, slopes.T @ wanted + _PULL * at, 0.5 * (wanted @ wanted + _PULL * at @ at)
    )


def _search(own: _Quadratic, bend: Float[Array, "t k"], pace: Float[Array, "t k"]) -> Int[Array, "h t"]:
    """The choices of all frames that cost least."""
    _, choices, size = own.slope.shape
    kept = min(HISTORIES, choices)

    def onward(
        before: _Quadratic, frame: tuple[_Quadratic, Array, Array]
    ) -> tuple[_Quadratic, tuple[Int[Array, "b"], Float[Array, "b"]]]:
        own, bend, pace = frame
        come = jax.vmap(lambda q: _eliminated(_extended(q, bend, pace), size))(before)
        both = jax.vmap(lambda one: jax.vmap(lambda q: _added(q, one))(come))(own)
        cost = jax.vmap(jax.vmap(_least))(both)
        least, came_from = jax.lax.top_k(-cost, kept)
        after = jax.tree.map(lambda leaf: jax.vmap(lambda row, at: row[at])(leaf, came_from), both)
        after = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), after)
        return after, (came_from.ravel(), -least.ravel())

    count = choices * kept
    start = _Quadratic(
        jnp.broadcast_to(jnp.eye(2 * size, dtype=own.slope.dtype), (count, 2 * size, 2 * size)),
        jnp.zeros((count, 2 * size), own.slope.dtype),
        jnp.where(jnp.arange(count) == 0, 0.0, jnp.inf).astype(own.slope.dtype),
    )
    _, (came_from, cost) = jax.lax.scan(onward, start, (own, bend, pace))

    def back(at: Int[Array, "h"], came_from: Int[Array, "b"]) -> tuple[Array, Array]:
        return came_from[at], at // kept

    _, last = jax.lax.top_k(-cost[-1], min(TRIED, len(cost[-1])))
    _, chosen = jax.lax.scan(back, last, came_from, reverse=True)
    return chosen.T


def _extended(q: _Quadratic, bend: Float[Array, "k"], pace: Float[Array, "k"]) -> _Quadratic:
    """A function of two frames as one of three, with what smoothness costs in the third."""
    size = bend.size
    rows = (bend, (1.0, -2.0, 1.0)), (pace, (0.0, -1.0, 1.0))
    differences = jnp.block([[part * jnp.diag(factor) for part in row] for factor, row in rows])
    matrix = jnp.pad(q.matrix, ((0, size), (0, size))) + differences.T @ differences
    return _Quadratic(matrix, jnp.pad(q.slope, (0, size)), q.rest)


def _added(q: _Quadratic, last: _Quadratic) -> _Quadratic:
    """A function of two frames and one of the last of them."""
    before = (q.slope.size - last.slope.size, 0)
    matrix, slope = jnp.pad(last.matrix, (before, before)), jnp.pad(last.slope, before)
    return _Quadratic(q.matrix + matrix, q.slope + slope, q.rest + last.rest)


def _eliminated(q: _Quadratic, count: int) -> _Quadratic:
    """The least over the first `count` variables, a function of the others."""
    a, b, c = q.matrix, q.slope, q.rest
    for _ in range(count):
        over = jnp.where(a[0, 0] > 0.0, 1.0 / a[0, 0], 0.0)
        c = c - 0.5 * over * b[0] ** 2
        b, a = b[1:] - over * b[0] * a[1:, 0], a[1:, 1:] - over * a[1:, 0, None] * a[None, 0, 1:]
    return _Quadratic(a, b, c)


def _least(q: _Quadratic) -> Float[Array, ""]:
    """The least over all variables."""
    return _eliminated(q, q.slope.size).rest
