"""Systems with the Hessian of coupled frames against dense ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.solvers import BandedJacobian, solve_hessian


@pytest.mark.parametrize("frames", [1, 2, 5, 6])
def test_it_solves_what_a_dense_solver_does(frames):
    """Indefinite blocks, other factors for each parameter, and some of them held."""
    rng = np.random.default_rng(frames)
    own = rng.normal(size=(frames, 3, 3))
    own = jnp.asarray(own + own.swapaxes(1, 2))
    bend = jnp.asarray(rng.uniform(1, 2, (frames, 3)) * (np.arange(frames) >= 2)[:, None])
    pace = jnp.asarray(rng.uniform(1, 2, (frames, 3)) * (np.arange(frames) >= 1)[:, None])
    moves = jnp.asarray(rng.random((frames, 3)) < 0.8)
    right = jnp.asarray(rng.normal(size=(frames, 3)))
    found = solve_hessian(own, bend, pace, moves, right)
    differences = BandedJacobian(jnp.zeros((frames, 1, 3)), bend, pace).as_matrix()
    matrix = np.array(differences.T @ differences)
    for frame in range(frames):
        part = slice(3 * frame, 3 * frame + 3)
        matrix[part, part] += own[frame]
    free = np.flatnonzero(moves.ravel())
    expected = np.zeros(3 * frames)
    expected[free] = np.linalg.solve(matrix[np.ix_(free, free)], right.ravel()[free])
    # Observed: 4e-14 of the largest.
    assert np.abs(found.ravel() - expected).max() < 1e-11 * np.abs(expected).max()


def test_what_nothing_determines_has_finite_answers():
    """A frame without a cost of its own, and no smoothness."""
    none = jnp.zeros((2, 1))
    own = jnp.array([[[2.0]], [[0.0]]])
    found = jax.jit(solve_hessian)(own, none, none, jnp.ones((2, 1), bool), jnp.array([[4.0], [0.0]]))
    np.testing.assert_allclose(found, [[2.0], [0.0]], rtol=1e-12)
