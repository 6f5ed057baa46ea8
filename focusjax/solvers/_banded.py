"""Least squares over a row of frames, each coupled to the two before it, in time linear in the frames.

The matrix has three block diagonals. It is brought to triangular form from the first frame to the last by
Householder's reflections of a few rows at a time, and solved from the last to the first: a square-root
information smoother (Bierman, Factorization Methods for Discrete Sequential Estimation, 1977). The normal
equations would square the condition number, which grows as the fourth power of a gap between wishes
in frames, beyond what float32 holds.
"""

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from focusjax.solvers._bounded import DampedOperator, transposed, without_symmetry

_SECOND = (1.0, -2.0, 1.0)
"""Second difference of a frame with the two before it."""

_FIRST = (0.0, -1.0, 1.0)
"""First difference, of the same frames."""

Rows: TypeAlias = tuple[Float[Array, "t m"], Float[Array, "t k"], Float[Array, "t k"]]
"""What belongs to the frames' own residuals, to second differences, and to first differences."""


@without_symmetry
class BandedJacobian(lx.AbstractLinearOperator):
    """The Jacobian of residuals of frames t that are coupled by differences over time.

    It takes changes d [t, k] of all frames' parameters to three kinds of rows:

        slopes_t d_t,
        bend_t (d_t - 2 d_(t-1) + d_(t-2)),
        pace_t (d_t - d_(t-1)).

    Attributes:
        slopes: of each frame's own residuals.
        bend: factor of every second difference; 0 for the first two frames.
        pace: factor of every first difference; 0 for the first frame.
    """

    slopes: Float[Array, "t m k"]
    bend: Float[Array, "t k"]
    pace: Float[Array, "t k"]

    def mv(self, vector: Float[Array, "t k"]) -> Rows:
        earlier = jnp.pad(vector, ((2, 0), (0, 0)))
        before, long_before = earlier[1:-1], earlier[:-2]
        bent = self.bend * (vector - 2.0 * before + long_before)
        return jnp.einsum("tmk,tk->tm", self.slopes, vector), bent, self.pace * (vector - before)

    def as_matrix(self) -> Float[Array, "r c"]:
        units = jnp.eye(self.bend.size, dtype=self.bend.dtype).reshape(-1, *self.bend.shape)
        rows = jax.vmap(self.mv)(units)
        return jnp.concatenate([leaf.reshape(len(units), -1) for leaf in rows], axis=1).T

    def transpose(self) -> lx.AbstractLinearOperator:
        return transposed(self)

    def in_structure(self) -> jax.ShapeDtypeStruct:
        return jax.eval_shape(lambda: self.bend)

    def out_structure(self) -> tuple[jax.ShapeDtypeStruct, ...]:
        return jax.eval_shape(lambda: (self.slopes[:, :, 0], self.bend, self.pace))


class BandedQR(lx.AbstractLinearSolver):
    """Solves linear least squares with a `DampedOperator` of a `BandedJacobian`, with damping above 0."""

    def init(self, operator: Any, options: dict[str, Any]) -> DampedOperator:
        if not (isinstance(operator, DampedOperator) and isinstance(operator.jacobian, BandedJacobian)):
            raise ValueError(f"operator is {type(operator).__name__}; BandedQR solves damped banded ones")
        return operator

    def compute(
        self, state: DampedOperator, vector: tuple[Rows, Array], options: dict[str, Any]
    ) -> tuple[Float[Array, "t k"], lx.RESULTS, dict[str, Any]]:
        return solve_banded(state, vector), lx.RESULTS.successful, {}

    def transpose(self, state: Any, options: dict[str, Any]) -> Any:
        raise NotImplementedError(
            "BandedQR does not solve the transposed problem, which derivatives of `lineax.linear_solve` need;"
            " differentiate `solve_banded`, or give `lineax.QR()`"
        )

    def conj(self, state: Any, options: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        return state, options

    def assume_full_rank(self) -> bool:
        return True


def solve_banded(operator: DampedOperator, vector: tuple[Rows, Array]) -> Float[Array, "t k"]:
    """The d that brings all rows of a damped `BandedJacobian` nearest to `vector`, by least squares.

    What `BandedQR` does, and differentiable by its steps. Damping is above 0.
    """
    jacobian, moves = operator.jacobian, operator.moves
    assert isinstance(jacobian, BandedJacobian)
    (rows, bent, paced), damped = vector
    size = moves.shape[1]
    # With the damping of a frame its own rows have full rank, as the derivative of QR needs.
    slopes = jnp.concatenate([jacobian.slopes * moves[:, None], jax.vmap(jnp.diag)(operator.root)], axis=1)
    wanted = jnp.concatenate([rows, damped], axis=1)
    own = jax.vmap(_triangle)(jnp.concatenate([slopes, wanted[..., None]], axis=2))
    earlier = jnp.concatenate([jnp.ones((2, size), moves.dtype), moves])
    none = jnp.zeros((size, 2 * size), moves.dtype)

    def differences(
        factor: Float[Array, "k"], what: tuple[float, ...], value: Float[Array, "k"], may: Float[Array, "3 k"]
    ) -> Float[Array, "k c"]:
        blocks = [c * jnp.diag(factor * may[step]) for step, c in enumerate(what)]
        return jnp.concatenate([*blocks, value[:, None]], axis=1)

    def forward(state: Float[Array, "s c"], frame: tuple[Array, ...]) -> tuple[Array, Array]:
        """Takes a frame in, and settles the one two before it as a function of the later ones."""
        own, bend, bent, pace, paced, may = frame
        widened = jnp.concatenate([state[:, :-1], none.T, state[:, -1:]], axis=1)
        ahead = jnp.concatenate([none, own], axis=1)
        rows = [widened, differences(bend, _SECOND, bent, may), differences(pace, _FIRST, paced, may)]
        solved = _triangle(jnp.concatenate([*rows, ahead]))
        return solved[size:, size:], solved[:size]

    def backward(later: Float[Array, "s"], rows: Float[Array, "k c"]) -> tuple[Array, Array]:
        known = rows[:, -1] - rows[:, size:-1] @ later
        found = jax.scipy.linalg.solve_triangular(rows[:, :size], known)
        return jnp.concatenate([found, later[:size]]), found

    # Two frames before the first that nothing is coupled to, and that stay 0.
    state = jnp.concatenate([jnp.eye(2 * size, dtype=moves.dtype), jnp.zeros((2 * size, 1), moves.dtype)], 1)
    may = jnp.stack([earlier[:-2], earlier[1:-1], earlier[2:]], axis=1)
    frames = own, jacobian.bend, bent, jacobian.pace, paced, may
    state, triangles = jax.lax.scan(forward, state, frames)
    last = jax.scipy.linalg.solve_triangular(state[:, :-1], state[:, -1])
    _, found = jax.lax.scan(backward, last, triangles, reverse=True)
    return jnp.concatenate([found, last.reshape(2, size)])[2:]


@jax.custom_jvp
def _triangle(rows: Float[Array, "m c"]) -> Float[Array, "d c"]:
    """The same least-squares problem (last column: what is wanted) with as many rows as unknowns."""
    return jnp.linalg.qr(rows, mode="r")[: rows.shape[1] - 1]


@_triangle.defjvp
def _triangle_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    """By QR of the unknowns' columns alone, which have full rank; with what is wanted they may not."""

    def apart(rows: Float[Array, "m c"]) -> Float[Array, "d c"]:
        turned, triangle = jnp.linalg.qr(rows[:, :-1])
        return jnp.concatenate([triangle, (turned.T @ rows[:, -1])[:, None]], axis=1)

    return jax.jvp(apart, primals, tangents)
