"""Linear systems with the second derivative of a cost over a row of frames, in time linear in the frames.

The cost is that of every frame by itself, and of squared differences over time as in `BandedJacobian`. Its
Hessian has blocks on the diagonal and two beside it, may be indefinite, and is eliminated two frames at a
time, with pivoting in these. It has what J^T J lacks, the curvature of residuals: for Newton's step, and for
how a solution follows what it depends on.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_RIDGE = 16.0
"""Rounding steps that are added to the diagonal, scaled to 1, so that there is an inverse."""


def solve_hessian(
    own: Float[Array, "t k k"],
    bend: Float[Array, "t k"],
    pace: Float[Array, "t k"],
    moves: Bool[Array, "t k"],
    right: Float[Array, "t k"],
) -> Float[Array, "t k"]:
    """The d of H d = `right`, with what does not move left at 0.

    Args:
        own: second derivative of every frame's own cost.
        bend: factor of every second difference; 0 for the first two frames.
        pace: factor of every first difference; 0 for the first frame.
        moves: what may change.
        right: right side; of no meaning where nothing moves.

    Example:
        >>> import jax.numpy as jnp
        >>> from focusjax.solvers import solve_hessian
        >>> pace, right = jnp.array([[0.0], [1.0], [1.0]]), jnp.array([[3.0], [3.0], [9.0]])
        >>> moves = jnp.array([[True], [True], [False]])
        >>> solve_hessian(2.0 * jnp.ones((3, 1, 1)), 0.0 * pace, pace, moves, right).round(2).ravel().tolist()
        [1.36, 1.09, 0.0]
    """
    count, size = right.shape
    none = jnp.zeros_like(right[:1])
    bend, pace = bend**2, pace**2
    ahead, beyond = jnp.concatenate([bend[1:], none]), jnp.concatenate([pace[1:], none])
    after = jnp.concatenate([ahead[1:], none])
    diagonal = bend + 4.0 * ahead + after + pace + beyond
    next_ = -2.0 * ahead - 2.0 * after - beyond
    own = own + jax.vmap(jnp.diag)(diagonal)
    # Every parameter of every frame in the unit that makes H's diagonal 1: a single ridge then suits all.
    steep = jnp.abs(jnp.diagonal(own, axis1=1, axis2=2))
    unit = 1.0 / jnp.sqrt(jnp.where(steep > 0.0, steep, 1.0))
    may = jnp.where(moves, unit, 0.0)
    ridge = jnp.where(moves, _RIDGE * jnp.finfo(right.dtype).eps, 1.0)
    own = own * may[:, :, None] * may[:, None, :] + jax.vmap(jnp.diag)(ridge)
    right = right * may

    # One more frame that stays, where they do not come in pairs.
    odd = count % 2
    own = jnp.concatenate([own, jnp.broadcast_to(jnp.eye(size, dtype=own.dtype)[None], (odd, size, size))])
    may, right, next_, after = (
        jnp.concatenate([each, jnp.zeros((odd, size), each.dtype)]) for each in (may, right, next_, after)
    )
    diagonals = jax.vmap(jnp.diag)
    a, b = may[0::2], may[1::2]
    inside = diagonals(next_[0::2] * a * b)
    blocks = jnp.block([[own[0::2], inside], [inside, own[1::2]]])
    # A pair's coupling to the pair after it, as rows of that one and columns of this.
    first = [diagonals(after[0:-2:2] * a[1:] * a[:-1]), diagonals(next_[1:-1:2] * a[1:] * b[:-1])]
    second = [jnp.zeros_like(own[2::2]), diagonals(after[1:-1:2] * b[1:] * b[:-1])]
    below = jnp.block([first, second])
    found = _block_tridiagonal(blocks, below, right.reshape(-1, 2 * size))
    return found.reshape(-1, size)[:count] * unit


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
