"""A solution's points are where its camera sees them, those that others refer to as well."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import (
    AtPoint,
    Blur,
    FocusPoint,
    SameBlur,
    Sharp,
    errors,
    locate,
    solve,
    solve_many,
    stacked,
)
from focusjax.geometry import make_camera
from focusjax.lens import tilt_shift_lens

# On a tilted lens blur depends on where a point is seen.
LENS = tilt_shift_lens(focus_distance=2.0, tilt=0.08, f_number=4.0, focal_length=0.05)
FREE = {"free": ("focus", "focal_length"), "focal_length_range": (0.03, 0.2)}


@pytest.mark.slow
def test_errors_at_the_zoomed_points_are_the_solutions():
    camera = make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)
    wishes = [
        FocusPoint(AtPoint((0.2, 0.1, -2)), Sharp()),
        FocusPoint(AtPoint((0.2, -0.3, -4)), Blur(5.0), name="lamp"),
        FocusPoint(AtPoint((-0.3, 0.4, -3)), SameBlur("lamp")),
    ]
    points = locate(wishes, camera)
    one = solve(points, camera, LENS, **FREE)
    many = solve_many(stacked([points, points]), camera, LENS, **FREE)
    assert abs(float(one.camera.focal_length) - 0.05) > 0.002
    for found in (one, jax.tree.map(lambda leaf: leaf[1], many)):
        # Observed: the same to the bit.
        again = errors(found.points, found.camera, found.lens)
        np.testing.assert_allclose(again, found.error, rtol=0, atol=1e-11)
