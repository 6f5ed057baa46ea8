"""The nearest point of a polytope, against scipy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from focusjax.focus._least_distance import least_distance


def by_scipy(goal, rows, room):
    """Lawson and Hanson's reduction to non-negative least squares (chapter 23)."""
    matrix = np.vstack([-rows.T, (rows @ goal - room)[None]])
    right = np.zeros(goal.size + 1)
    right[-1] = 1.0
    dual, _ = scipy.optimize.nnls(matrix, right)
    residual = matrix @ dual - right
    return goal - residual[:-1] / residual[-1]


# Observed: 4e-13 and 6e-4.
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-11), (np.float32, 2e-3)])
def test_it_is_scipys(dtype, tolerance):
    rng = np.random.default_rng(0)
    solve = jax.jit(least_distance)
    for case in range(100):
        rows, room = rng.normal(size=(8, 3)), np.maximum(rng.normal(size=8), 0.0)
        goal = 3.0 * rng.normal(size=3)
        if case % 5 == 0:
            rows[3] = 0.0
        if case % 7 == 0:
            rows[4], room[4] = rows[5], room[5]
        found = solve(*(jnp.asarray(each, dtype) for each in (goal, rows, room)))
        np.testing.assert_allclose(found, by_scipy(goal, rows, room), atol=tolerance)


def test_a_goal_inside_is_kept():
    found = least_distance(jnp.array([0.5, -1.0]), jnp.eye(2), jnp.array([2.0, 1.0]))
    np.testing.assert_allclose(found, [0.5, -1.0], atol=1e-12)


def test_no_room_at_all():
    rows = jnp.concatenate([jnp.eye(2), -jnp.eye(2)])
    found = least_distance(jnp.array([1.0, 2.0]), rows, jnp.zeros(4))
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


@pytest.mark.parametrize("goal", [0.0, 1e-30, 1e30])
def test_it_is_finite(goal):
    found = least_distance(jnp.full(2, goal), jnp.eye(2), jnp.array([1.0, 0.0]))
    assert np.isfinite(found).all()
