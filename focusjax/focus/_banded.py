"""Least squares over a row of frames, each coupled to the two before it, in time linear in the frames.

The matrix has three block diagonals. It is brought to triangular form from the first frame to the last by
Householder's reflections of a few rows at a time, and solved from the last to the first: a square-root
information smoother (Bierman, Factorization Methods for Discrete Sequential Estimation, 1977). The normal
equations would square the condition number, which grows as the fourth power of a gap between wishes
in frames, beyond what float32 holds.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

SECOND = (1.0, -2.0, 1.0)
"""Second difference of a frame with the two before it."""

FIRST = (0.0, -1.0, 1.0)
"""First difference, of the same frames."""


def banded_least_squares(
    jacobian: Float[Array, "t m k"],
    residual: Float[Array, "t m"],
    bend: Float[Array, "t k"],
    bend_residual: Float[Array, "t k"],
    pace: Float[Array, "t k"],
    pace_residual: Float[Array, "t k"],
    damping: Float[Array, ""],
    moves: Float[Array, "t k"],
) -> Float[Array, "t k"]:
    """The change d of all frames' parameters that minimises a sum of squares.

    They are those of

        jacobian_t d_t + residual_t,
        bend_t (d_t - 2 d_(t-1) + d_(t-2)) + bend_residual_t,
        pace_t (d_t - d_(t-1)) + pace_residual_t,
        sqrt(damping) d_t.

    Args:
        jacobian: of each frame's own residuals.
        residual: each frame's own.
        bend: factor of every second difference; 0 for the first two frames.
        bend_residual: what the second differences start from, times `bend`.
        pace: factor of every first difference; 0 for the first frame.
        pace_residual: what the first differences start from, times `pace`.
        damping: positive, so that there is one answer.
        moves: 1 for what may change, 0 for what stays: its d is 0.
    """
    size = moves.shape[1]
    own = jax.vmap(_triangle)(jnp.concatenate([jacobian * moves[:, None], residual[..., None]], axis=-1))
    earlier = jnp.concatenate([jnp.ones((2, size), moves.dtype), moves])
    identity, none = jnp.eye(size, dtype=moves.dtype), jnp.zeros((size, 1), moves.dtype)
    damped = jnp.concatenate(
        [jnp.zeros((size, 2 * size), moves.dtype), jnp.sqrt(damping) * identity, none], 1
    )

    def differences(
        factor: Float[Array, "k"], what: tuple[float, ...], value: Float[Array, "k"], may: Float[Array, "3 k"]
    ) -> Float[Array, "k c"]:
        blocks = [c * jnp.diag(factor * may[step]) for step, c in enumerate(what)]
        return jnp.concatenate([*blocks, value[:, None]], axis=1)

    def forward(state: Float[Array, "s c"], frame: tuple[Array, ...]) -> tuple[Array, Array]:
        """Takes a frame in, and settles the one two before it as a function of the later ones."""
        own, bend, bent, pace, paced, may = frame
        widened = jnp.concatenate([state[:, :-1], jnp.zeros((2 * size, size), own.dtype), state[:, -1:]], 1)
        ahead = jnp.concatenate([jnp.zeros((size, 2 * size), own.dtype), own], axis=1)
        rows = [widened, differences(bend, SECOND, bent, may), differences(pace, FIRST, paced, may)]
        solved = _triangle(jnp.concatenate([*rows, ahead, damped]))
        return solved[size:, size:], solved[:size]

    def backward(later: Float[Array, "s"], rows: Float[Array, "k c"]) -> tuple[Array, Array]:
        known = rows[:, size:-1] @ later + rows[:, -1]
        found = -jax.scipy.linalg.solve_triangular(rows[:, :size], known)
        return jnp.concatenate([found, later[:size]]), found

    # Two frames before the first that nothing is coupled to, and that stay 0.
    state = jnp.concatenate([jnp.eye(2 * size, dtype=moves.dtype), jnp.zeros((2 * size, 1), moves.dtype)], 1)
    may = jnp.stack([earlier[:-2], earlier[1:-1], earlier[2:]], axis=1)
    state, rows = jax.lax.scan(forward, state, (own, bend, bend_residual, pace, pace_residual, may))
    last = -jax.scipy.linalg.solve_triangular(state[:, :-1], state[:, -1])
    _, found = jax.lax.scan(backward, last, rows, reverse=True)
    return jnp.concatenate([found, last.reshape(2, size)])[2:] * moves


def _triangle(rows: Float[Array, "m c"]) -> Float[Array, "d c"]:
    """The same least-squares problem (last column: residuals) with as many rows as unknowns."""
    unknowns = rows.shape[1] - 1
    short = max(0, unknowns - rows.shape[0])
    padded = jnp.concatenate([rows, jnp.zeros((short, rows.shape[1]), rows.dtype)])
    return jnp.linalg.qr(padded, mode="r")[:unknowns]
