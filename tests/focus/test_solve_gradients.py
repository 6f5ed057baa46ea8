"""The derivative through the solve is that of solving again."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import solve

BOTH = ("focus", "f_number")
ROWS = ((0.5, 0.0, True, 1.0), (1.0, 12.0, False, 2.0), (0.2, 7.0, True, 0.5), (0.4, 3.0, False, 1.0))


def parameters(solution):
    """Both solved parameters, scaled to be of one size."""
    return jnp.stack([solution.lens.focus_disparity, 1e2 * solution.lens.aperture_radius])


def differences(function, values, step=1e-5):
    columns = []
    for index in range(values.size):
        shift = jnp.zeros_like(values).at[index].set(step)
        columns.append((function(values + shift) - function(values - shift)) / (2 * step))
    return jnp.stack(columns, axis=-1)


@pytest.mark.parametrize(
    ("arguments", "active"),
    [
        ({}, ()),
        ({"free": BOTH}, ()),
        ({"free": BOTH, "f_number_range": (2.0, 8.0)}, ("min_f_number",)),
        ({"free": BOTH, "min_focus_distance": 2.2}, ("min_focus_distance",)),
    ],
    ids=["focus", "both", "f-number at its bound", "focus at its bound"],
)
def test_derivative_is_that_of_solving_again(make_setup, make_points, arguments, active):
    camera, lens = make_setup(f_number=2.5)
    points = make_points(*ROWS, size=4)
    assert solve(points, camera, lens, **arguments).active_bounds == active

    def solved(values):
        disparity, target, weight = values.reshape(3, 4)
        changed = dataclasses.replace(points, disparity=disparity, target=target, weight=weight)
        return parameters(solve(changed, camera, lens, **arguments))

    values = jnp.concatenate([points.disparity, points.target, points.weight])
    expected = differences(solved, values)
    forward, backward = jax.jacfwd(solved)(values), jax.jacrev(solved)(values)
    # Observed 6e-10, the differences' own error.
    np.testing.assert_allclose(forward, expected, atol=1e-8, rtol=0)
    np.testing.assert_allclose(backward, forward, atol=1e-14, rtol=0)


def test_derivative_with_respect_to_bounds(make_setup, make_points):
    camera, lens = make_setup(f_number=4.0)
    points = make_points(*ROWS, size=4)

    def solved(values):
        near, widest = values
        limits = {"min_focus_distance": near, "f_number_range": (widest, 16.0)}
        return parameters(solve(points, camera, lens, free=BOTH, **limits))

    # Both bounds are active: the solution moves as they do.
    derivative = jax.jacfwd(solved)(jnp.array([3.5, 3.0]))
    expected = np.diag([-1 / 3.5**2, -1e2 * 0.025 / 3.0**2])
    np.testing.assert_allclose(derivative, expected, rtol=1e-12, atol=1e-14)


def test_what_is_left_open_has_a_finite_derivative(make_setup, make_points):
    camera, lens = make_setup()
    points = make_points((0.5, 0.0, True, 1.0), (0.5, 0.0, True, 0.0))

    def focus(disparity):
        changed = dataclasses.replace(points, disparity=disparity)
        return solve(changed, camera, lens, free=BOTH).lens.focus_disparity

    np.testing.assert_allclose(jax.grad(focus)(points.disparity), [1.0, 0.0], atol=1e-12)
