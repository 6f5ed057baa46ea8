"""The derivative through the solve is that of solving again."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients
from jaxtyping import Array, Float

from focusjax.focus import ImagePoints, Solution, solve
from focusjax.geometry import Camera
from focusjax.lens import ThinLens

ROWS = ((0.5, 0.0, True, 1.0), (1.0, 12.0, False, 2.0), (0.2, 7.0, True, 0.5), (0.4, 3.0, False, 1.0))


class Solved(eqx.Module):
    """Focus and aperture as a function of the points' fields and the limits; compiled once for all rows."""

    points: ImagePoints
    camera: Camera
    lens: ThinLens

    def solution(self, values: Float[Array, "15"]) -> Solution:
        disparity, target, weight = values[:12].reshape(3, 4)
        changed = dataclasses.replace(self.points, disparity=disparity, target=target, weight=weight)
        near, *ends = values[12:]
        return solve(
            changed, self.camera, self.lens,
            free=("focus", "f_number"), min_focus_distance=near, f_number_range=tuple(ends),
        )  # fmt: skip

    def __call__(self, values: Float[Array, "15"]) -> Float[Array, "2"]:
        found = self.solution(values).lens
        return jnp.stack([found.focus_disparity, 1e2 * found.aperture_radius])


@pytest.fixture
def make_solved(make_setup, make_points):
    """Builds (function, values)."""

    def build(rows=ROWS, *, min_focus_distance=0.1, f_number_range=(1.0, 32.0)):
        points = make_points(*rows, size=4)
        limits = jnp.array([min_focus_distance, *f_number_range])
        values = jnp.concatenate([points.disparity, points.target, points.weight, limits])
        return Solved(points, *make_setup(f_number=4.0)), values

    return build


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
    """Forwards, too."""
    solved, values = make_solved(**arguments)
    assert solved.solution(values).active_bounds == active
    check_gradients(solved, values, rtol=1e-8)


def test_what_is_left_open_stays_and_the_rest_moves(make_solved):
    """The focus moves with the points, and by 1 / (2 f E) per pixel of blur.

    It is a = 2 f E (w - u_0) pixels from the start. Of a blur of t px, a^2 + (a + t)^2 and the aperture's
    10 px squared times (x - 1)^2 are least together for an opening of x = 1 + a t / 100.
    """
    solved, values = make_solved([(0.5, 0.0, True, 1.0)] * 4)
    assert solved.solution(values).undetermined == ("f_number",)
    expected = np.zeros((2, values.size))
    expected[0, :4] = 1 / 4
    gain = 2 * 0.05 / 0.036 * 640 * 0.00625
    expected[0, 4:8] = 1 / 4 / gain
    start = float(solved.lens.focus_disparity)
    expected[1, 4:8] = 1e2 * 0.00625 * gain * (0.5 - start) / 100 / 4
    np.testing.assert_allclose(check_gradients(solved, values), expected, atol=1e-12)
