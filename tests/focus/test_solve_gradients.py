"""The derivative through the solve is that of solving again."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import solve

BOTH = ("focus", "f_number")
ROWS = ((0.5, 0.0, True, 1.0), (1.0, 12.0, False, 2.0), (0.2, 7.0, True, 0.5), (0.4, 3.0, False, 1.0))


@pytest.fixture
def make_solved(make_setup, make_points):
    """Builds (solve, values): both parameters as a function of the points' fields and the limits."""

    def build(rows=ROWS, *, free=BOTH, min_focus_distance=0.1, f_number_range=(1.0, 32.0)):
        camera, lens = make_setup(f_number=4.0)
        points = make_points(*rows, size=4)

        def solved(values):
            disparity, target, weight = values[:12].reshape(3, 4)
            changed = dataclasses.replace(points, disparity=disparity, target=target, weight=weight)
            near, *ends = values[12:]
            return solve(
                changed, camera, lens, free=free, min_focus_distance=near, f_number_range=tuple(ends)
            )

        def parameters(values):
            found = solved(values).lens
            return jnp.stack([found.focus_disparity, 1e2 * found.aperture_radius])

        limits = jnp.array([min_focus_distance, *f_number_range])
        values = jnp.concatenate([points.disparity, points.target, points.weight, limits])
        return parameters, values, solved(values).active_bounds

    return build


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
        ({"f_number_range": (3.0, 8.0)}, ("min_f_number",)),
        ({"min_focus_distance": 2.2}, ("min_focus_distance",)),
        ({"min_focus_distance": 3.5, "f_number_range": (3.0, 8.0)}, ("min_focus_distance", "min_f_number")),
    ],
    ids=["both", "f-number at its bound", "focus at its bound", "both at their bounds"],
)
def test_derivative_is_that_of_solving_again(make_solved, arguments, active):
    parameters, values, bounds = make_solved(**arguments)
    assert bounds == active
    expected = differences(parameters, values)
    # Observed 6e-10, the differences' own error.
    np.testing.assert_allclose(jax.jacrev(parameters)(values), expected, atol=1e-8, rtol=0)


def test_forward_and_backward_derivatives_agree(make_solved):
    parameters, values, _ = make_solved()
    direction = jnp.cos(jnp.arange(values.size))
    forward = jax.jvp(parameters, (values,), (direction,))[1]
    # Observed 2e-16.
    np.testing.assert_allclose(forward, jax.jacrev(parameters)(values) @ direction, atol=1e-14, rtol=0)


def test_what_is_left_open_has_a_finite_derivative(make_solved):
    parameters, values, _ = make_solved([(0.5, 0.0, True, 1.0)])
    expected = np.zeros((2, values.size))
    # The aperture is kept, so the focus moves with the point, and by 1 / (2 f E) per pixel of blur.
    expected[0, 0] = 1.0
    expected[0, 4] = 1 / (2 * 0.05 / 0.036 * 640 * 0.00625)
    np.testing.assert_allclose(jax.jacrev(parameters)(values), expected, atol=1e-12)
