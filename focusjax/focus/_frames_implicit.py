"""How the solution of all frames follows the wishes, by the implicit function theorem.

At the solution the gradient g(x, theta) of the cost vanishes along every parameter that no bound pins, so
H dx = -dg: with H the cost's second derivative, and dg the change of g with wishes, bounds and all else. H
has three blocks beside its diagonal, those of a frame with the two before it, and is eliminated in time
linear in the frames. The sides that wishes have chosen, and the active bounds, are held.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax.focus._joint import Joint
from focusjax.focus._objective import Objective

_RIDGE = 16.0
"""Rounding steps that are added to H's diagonal, scaled to 1, so that it has an inverse."""

_OPEN_RIDGE = 1e3
"""Rounding steps of H's largest entry that are added for what the wishes leave open, so that it stays."""


def following(
    joint: Joint,
    pixels: Float[Array, "t k"],
    side: Float[Array, "t n"],
    at_lower: Bool[Array, "t k"],
    at_upper: Bool[Array, "t k"],
    kept: Float[Array, "t k"],
    open_: Bool[Array, "k"],
) -> Float[Array, "t k"]:
    """`pixels`, with the derivative of the solution with respect to all that `joint` holds.

    Args:
        joint: the problem, with derivatives.
        pixels: its solution, without.
        side: the sides that points are on there.
        at_lower: parameters that a lower bound keeps from a better value; they follow the bound.
        at_upper: the same for upper bounds.
        kept: values of 0 whose derivatives are those of what the wishes leave open.
        open_: parameters that have a part in what the wishes leave open.
    """
    pinned = at_lower | at_upper
    here = jnp.where(at_lower, joint.lower, jnp.where(at_upper, joint.upper, pixels))
    start = pixels + (here - jax.lax.stop_gradient(here)) + kept
    slope = joint.linearised(start, side).gradient
    off = jnp.where(pinned, 0.0, slope - jax.lax.stop_gradient(slope))
    fixed = jax.lax.stop_gradient(joint)
    return start - _solved(_curvature(fixed, pixels, side), fixed, ~pinned, open_, off)


def _curvature(joint: Joint, pixels: Float[Array, "t k"], side: Float[Array, "t n"]) -> Float[Array, "t k k"]:
    """Second derivative of every frame's own cost."""

    def own(
        frame: Objective, scale: Float[Array, "k"], pixels: Float[Array, "k"], side: Float[Array, "n"]
    ) -> Float[Array, "k k"]:
        def cost(pixels: Float[Array, "k"]) -> Float[Array, ""]:
            value = pixels / scale
            wishes = frame.points.weight @ frame.errors(value, side) ** 2
            return 0.5 * (wishes + jnp.sum(frame.priors(value) ** 2)) / joint.unit

        return jax.hessian(cost)(pixels)

    return jax.vmap(own)(joint.frames, joint.scale, pixels, side)


def _solved(
    curvature: Float[Array, "t k k"],
    joint: Joint,
    moves: Bool[Array, "t k"],
    open_: Bool[Array, "k"],
    right: Float[Array, "t k"],
) -> Float[Array, "t k"]:
    """H^-1 `right`, with what does not move left at 0.

    Two frames make a block: H is then block-tridiagonal.
    """
    count, size = right.shape
    bend, pace = joint.bend[:, 0] ** 2, joint.pace[:, 0] ** 2
    ahead, beyond = (jnp.concatenate([w[1:], jnp.zeros(1, w.dtype)]) for w in (bend, pace))
    farthest = jnp.concatenate([ahead[1:], jnp.zeros(1, ahead.dtype)])
    diagonal = bend + 4.0 * ahead + farthest + pace + beyond
    next_ = -2.0 * ahead - 2.0 * farthest - beyond
    after = farthest
    identity = jnp.eye(size, dtype=right.dtype)
    own = curvature + diagonal[:, None, None] * identity[None]
    eps = jnp.finfo(right.dtype).eps
    stiff = jnp.where(open_, _OPEN_RIDGE * eps * jnp.max(jnp.abs(own)), 0.0)
    own = own + (stiff[:, None] * identity)[None]
    # Every parameter of every frame in the unit that makes H's diagonal 1: a single ridge then suits all.
    steep = jnp.abs(jnp.diagonal(own, axis1=1, axis2=2))
    unit = 1.0 / jnp.sqrt(jnp.where(steep > 0.0, steep, 1.0))
    may = jnp.where(moves, unit, 0.0)
    held = jnp.where(moves, _RIDGE * eps, 1.0)
    own = own * may[:, :, None] * may[:, None, :] + held[:, :, None] * identity[None]
    right = right * may

    # One more frame that stays, where they do not come in pairs.
    odd = count % 2
    own = jnp.concatenate([own, jnp.broadcast_to(identity[None], (odd, size, size))])
    may, right = (jnp.concatenate([each, jnp.zeros((odd, size), each.dtype)]) for each in (may, right))
    next_, after = (jnp.concatenate([each, jnp.zeros(odd, each.dtype)]) for each in (next_, after))

    def coupling(factor: Float[Array, "p"], one: Float[Array, "p k"], other: Float[Array, "p k"]) -> Array:
        return factor[:, None, None] * (one * other)[:, :, None] * identity[None]

    a, b = may[0::2], may[1::2]
    inside = coupling(next_[0::2], a, b)
    blocks = _square(own[0::2], inside, inside, own[1::2])
    zero = jnp.zeros_like(own[2::2])
    # A pair's coupling to the pair after it, as rows of that one and columns of this.
    below = _square(
        coupling(after[0:-2:2], a[1:], a[:-1]),
        coupling(next_[1:-1:2], a[1:], b[:-1]),
        zero,
        coupling(after[1:-1:2], b[1:], b[:-1]),
    )
    found = _block_tridiagonal(blocks, below, right.reshape(-1, 2 * size))
    return found.reshape(-1, size)[:count] * unit


def _square(
    a: Float[Array, "p k k"], b: Float[Array, "p k k"], c: Float[Array, "p k k"], d: Float[Array, "p k k"]
) -> Float[Array, "p j j"]:
    return jnp.concatenate([jnp.concatenate([a, b], axis=2), jnp.concatenate([c, d], axis=2)], axis=1)


def _block_tridiagonal(
    blocks: Float[Array, "p j j"], below: Float[Array, "q j j"], right: Float[Array, "p j"]
) -> Float[Array, "p j"]:
    """The solution of a symmetric block-tridiagonal system; one block below the diagonal less than on it."""
    none = jnp.zeros_like(blocks[:1])
    lower, upper = jnp.concatenate([none, below]), jnp.concatenate([jnp.swapaxes(below, 1, 2), none])

    def forward(before: tuple[Array, Array], block: tuple[Array, ...]) -> tuple[Any, Any]:
        carried, known = before
        own, lower, upper, right = block
        pivot = own - lower @ carried
        both = jnp.linalg.solve(pivot, jnp.concatenate([upper, (right - lower @ known)[:, None]], axis=1))
        return (both[:, :-1], both[:, -1]), (both[:, :-1], both[:, -1])

    start = jnp.zeros_like(blocks[0]), jnp.zeros_like(right[0])
    _, (carried, known) = jax.lax.scan(forward, start, (blocks, lower, upper, right))

    def backward(later: Float[Array, "j"], block: tuple[Array, Array]) -> tuple[Array, Array]:
        carried, known = block
        found = known - carried @ later
        return found, found

    _, found = jax.lax.scan(backward, jnp.zeros_like(right[0]), (carried, known), reverse=True)
    return found
