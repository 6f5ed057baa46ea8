"""Errors and residuals have the signs and slopes they are said to have."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import blurs, errors, residuals


def test_errors_by_hand(make_setup, make_points):
    camera, lens = make_setup(focus_distance=2.0)
    # 2 f E = 2 (0.05 / 0.036 * 640) 0.0125 = 22.2 px per dioptre; 4 m is behind the focus, 1 m before.
    points = make_points(
        (0.25, 4.0, True, 1), (1.0, 4.0, False, 4), (1.0, -4.0, True, 0.25), (0.5, 0, True, 1), size=4
    )
    np.testing.assert_allclose(blurs(points, camera, lens), np.array([0.25, -0.5, -0.5, 0]) * 200 / 9)
    expected = np.array([50 / 9 - 4, 100 / 9 - 4, -100 / 9 + 4, 0])
    np.testing.assert_allclose(errors(points, camera, lens), expected, atol=1e-14)
    np.testing.assert_allclose(residuals(points, camera, lens), expected * [1, 2, 0.5, 1], atol=1e-14)


@pytest.mark.parametrize("parameter", ["focus_disparity", "aperture_radius"])
def test_slopes_match_differences(make_setup, make_points, parameter):
    camera, lens = make_setup()
    points = make_points((0.25, 4.0, True, 1), (1.0, 4.0, False, 4), (0.0, 4.0, False, 1e-3), size=3)

    def at(value):
        return residuals(points, camera, eqx.tree_at(lambda lens: getattr(lens, parameter), lens, value))

    value = getattr(lens, parameter)
    step = 1e-5 * value
    differences = (at(value + step) - at(value - step)) / (2 * step)
    # Piecewise linear, so differences are exact: observed 3e-11 relative, which is rounding.
    np.testing.assert_allclose(jax.jacfwd(at)(value), differences, rtol=1e-9)
    np.testing.assert_allclose(jax.jacrev(at)(value), differences, rtol=1e-9)


def test_slopes_are_finite_where_the_size_and_the_root_have_none(make_setup, make_points):
    camera, lens = make_setup(focus_distance=2.0)
    points = make_points((0.5, 4.0, False, 1), (1.0, 4.0, False, 0))

    def total(points, lens):
        return jnp.sum(residuals(points, camera, lens))

    grads = eqx.filter_grad(lambda both: total(*both))((points, lens))
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(grads))
