"""The solve refuses what makes no sense, and says when it did not get there."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from focusjax.focus import ArgumentError, Prior, Result, solve

BOTH = ("focus", "f_number")


class TestRefusals:
    good = (0.4, 0.0, True, 1.0)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (
                {"min_focus_distance": 0.05},
                "minimum focus distance in metres is 0.05; expected a finite dist",
            ),
            ({"min_focus_distance": float("nan")}, "minimum focus distance in metres is nan"),
            (
                {"min_focus_distance": 2.0, "max_focus_distance": 1.0},
                "maximum focus distance in metres is 1; expected more than the minimum, or infinity",
            ),
            ({"f_number_range": (0.0, 8.0)}, "the f-number range's start is 0; expected a positive number"),
            ({"f_number_range": (8.0, 2.0)}, "the f-number range's end is 2; expected a finite number above"),
            ({"f_number_range": (2.0, np.inf)}, "the f-number range's end is inf; expected a finite number"),
            ({"free": BOTH, "f_number_range": (2.8, 8.0)}, "the starting f-number is 2; expected a value in"),
            ({"free": ("zoom",)}, "free parameters are .'zoom'.; expected"),
            ({"free": ("focal_length",)}, "the focal length is free without a range; give"),
            ({"free": ("tilt",), "tilt_range": (0.1, 0.2)}, "the starting tilt in radians is -?0; expected"),
            ({"priors": {"tilt": Prior(0.0, 1.0)}}, "there is a prior for 'tilt', which is not free"),
            ({"solver": "magic"}, "solver is the text 'magic'; expected a solver of Optimistix"),
        ],
    )
    def test_of_arguments(self, make_setup, make_points, arguments, message):
        camera, lens = make_setup()
        with pytest.raises(ValueError, match=message):
            solve(make_points(self.good), camera, lens, **arguments)

    @pytest.mark.parametrize(
        ("row", "message"),
        [
            ((-0.1, 0.0, True, 1.0), "a focus point's disparity is -0.1; expected 0"),
            ((np.nan, 0.0, True, 1.0), "a focus point's disparity is nan; expected 0"),
            ((0.1, -2.0, False, 1.0), "a focus point's wished blur is -2; expected a finite number"),
            ((0.1, 0.0, True, -1.0), "a focus point's weight is -1; expected zero or a positive"),
            ((0.1, 0.0, True, np.inf), "a focus point's weight is inf; expected zero or a positive"),
        ],
    )
    def test_of_points(self, make_setup, make_points, row, message):
        camera, lens = make_setup()
        with pytest.raises(ValueError, match=message):
            solve(make_points(self.good, row), camera, lens)

    def test_of_points_without_weight(self, make_setup, make_points):
        camera, lens = make_setup()
        with pytest.raises(ValueError, match="every focus point's weight is 0; expected at least one"):
            solve(make_points((0.4, 0, True, 0.0)), camera, lens)

    def test_of_no_points(self, make_setup, make_points):
        camera, lens = make_setup()
        none = jax.tree.map(lambda leaf: leaf[:0], make_points(self.good))
        with pytest.raises(ValueError, match="there are no focus points"):
            solve(none, camera, lens)

    def test_inside_compiled_code(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points(self.good)

        @eqx.filter_jit
        def far(weight):
            changed = dataclasses.replace(points, weight=weight)
            return solve(changed, camera, lens).lens.focus_disparity

        np.testing.assert_allclose(far(jnp.ones(6)), 0.4)
        with pytest.raises(RuntimeError, match="a focus point's weight is out of range; expected zero or a"):
            far(-jnp.ones(6)).block_until_ready()


class TestFailure:
    row = ((0.4, 3.0, True, 1), (0.1, 7.0, True, 1))
    solver = optx.LevenbergMarquardt(1e-8, 1e-8)

    def test_is_reported(self, make_setup, make_points):
        camera, lens = make_setup()
        solution = solve(make_points(*self.row), camera, lens, solver=self.solver, max_steps=1, throw=False)
        assert solution.result == Result.max_steps_reached
        lens = solution.lens
        assert np.isfinite([lens.focus_disparity, lens.aperture_radius]).all()

    def test_no_steps_are_refused(self, make_setup, make_points):
        camera, lens = make_setup()
        with pytest.raises(ArgumentError, match="max_steps is 0; expected a whole number, at least 1"):
            solve(make_points(*self.row), camera, lens, max_steps=0)

    def test_is_raised(self, make_setup, make_points):
        camera, lens = make_setup()
        with pytest.raises(RuntimeError, match="as many steps as it was allowed"):
            solve(make_points(*self.row), camera, lens, solver=self.solver, max_steps=1)
