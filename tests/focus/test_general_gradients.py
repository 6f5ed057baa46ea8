"""Residuals of every kind have the right slopes, and solutions follow what was wished."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients

from focusjax.focus import AT_LEAST, AT_MOST, EQUAL, SAME, ImagePoints, Prior, residuals, solve
from focusjax.geometry import make_camera
from focusjax.lens import tilt_shift_lens

ALL = ("focus", "f_number", "tilt", "swing")


@pytest.fixture
def camera():
    return make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)


@pytest.fixture
def lens():
    return tilt_shift_lens(focus_distance=2.0, f_number=4.0, focal_length=0.05, tilt=0.05, swing=-0.03)


@pytest.fixture
def points():
    """Rows of every kind, limits broken and kept, none near a kink."""
    relation = jnp.array([EQUAL, EQUAL, AT_MOST, AT_MOST, AT_LEAST, AT_LEAST, SAME, SAME])
    return ImagePoints(
        xy=jnp.array(
            [[90.0, 400], [500, 60], [320, 240], [600, 300], [50, 50], [200, 440], [400, 99], [9, 300]]
        ),
        disparity=jnp.array([0.9, 0.2, 0.1, 0.45, 0.3, 1.4, 1.1, 0.05]),
        target=jnp.array([-4.0, 3.0, 2.0, 9.0, 11.0, 2.0, 0.0, 0.0]),
        signed=jnp.array([True, False, False, False, False, False, True, False]),
        weight=jnp.array([1.0, 2.0, 0.5, 1.0, 3.0, 1.0, 0.7, 1.3]),
        tolerance=jnp.ones(8),
        wish=jnp.arange(8),
        names=tuple("abcdefgh"),
        relation=relation,
        reference=jnp.tile(jnp.array([[333.0, 111.0, 0.8]]), (8, 1)),
    )  # fmt: skip


def residuals_of(values, points, camera, lens):
    """Residuals as a function of plane, aperture radius, focal length and every float of the points."""
    plane, radius, length, xy, disparity, target, weight, reference = values
    points = dataclasses.replace(
        points, xy=xy, disparity=disparity, target=target, weight=weight, reference=reference
    )
    camera = dataclasses.replace(camera, focal_length=length)
    return residuals(points, camera, dataclasses.replace(lens, plane=plane, aperture_radius=radius))


def test_residuals_have_the_right_slopes_in_every_parameter(camera, lens, points):
    values = (
        lens.plane, lens.aperture_radius, camera.focal_length,
        points.xy, points.disparity, points.target, points.weight, points.reference,
    )  # fmt: skip

    def function(values):
        return residuals_of(values, points, camera, lens)

    found = np.asarray(function(values))
    assert (found[[3, 5]] == 0).all()
    assert (np.abs(found[[0, 1, 2, 4, 6, 7]]) > 0.5).all()
    check_gradients(function, values)


@pytest.mark.parametrize("relation", [AT_MOST, AT_LEAST])
def test_a_limit_just_met_has_a_finite_slope(camera, lens, points, relation):
    def cost(focus):
        moved = dataclasses.replace(lens, plane=lens.plane.at[2].set(focus))
        rows = dataclasses.replace(points, relation=jnp.full(8, relation))
        return jnp.sum(residuals(rows, camera, moved) ** 2)

    # Where the blur of the third row is exactly its limit, 2 px.
    focus = 0.1 + 2.0 / (2 * camera.focal_px * lens.aperture_radius)
    step = 1e-6
    difference = (cost(focus + step) - cost(focus - step)) / (2 * step)
    np.testing.assert_allclose(jax.grad(cost)(focus), difference, rtol=1e-5)


def test_an_idle_limit_has_a_finite_slope(camera, lens, points):
    at_focus = dataclasses.replace(
        points, relation=jnp.full(8, AT_LEAST), disparity=jnp.full(8, 0.5), xy=jnp.full((8, 2), 320.0)
    )
    upright = dataclasses.replace(lens, plane=jnp.array([0.0, 0.0, 0.5]))
    slopes = jax.jacrev(lambda p: residuals(dataclasses.replace(at_focus, disparity=p), camera, upright))
    assert np.isfinite(slopes(at_focus.disparity)).all()


@pytest.mark.parametrize(
    ("free", "options"),
    [
        (ALL, {"tilt_range": (-0.1, 0.06), "f_number_range": (3.0, 6.0)}),
        pytest.param(
            ("focus", "tilt", "focal_length"),
            {"focal_length_range": (0.03, 0.09), "priors": {"focal_length": Prior(0.05, 0.002)}},
            marks=pytest.mark.slow,
        ),
    ],
    ids=["bounds", "zoom"],
)
def test_solutions_follow_the_wishes(camera, lens, points, free, options):
    """The implicit derivative is that of solving again."""

    def solved(values):
        disparity, weight = values[:16].reshape(2, 8)
        target = jnp.concatenate([values[16:], points.target[6:]])
        changed = dataclasses.replace(points, disparity=disparity, target=target, weight=weight)
        found = solve(changed, camera, lens, free=free, min_focus_distance=0.5, **options)
        length = found.camera.focal_length
        return jnp.concatenate([found.lens.plane, 1e2 * found.lens.aperture_radius[None], 1e2 * length[None]])

    values = jnp.concatenate([points.disparity, points.weight, points.target[:6]])
    derivative = jax.jacrev(solved)(values)
    step = 1e-5
    columns = [
        (solved(values.at[i].add(step)) - solved(values.at[i].add(-step))) / (2 * step) for i in range(22)
    ]
    # Observed 3e-8 relative, the differences' own error.
    scale = float(jnp.abs(derivative).max())
    assert scale > 1e-3
    np.testing.assert_allclose(derivative, jnp.stack(columns, axis=-1), rtol=0, atol=1e-6 * scale)


@pytest.mark.slow
def test_what_is_left_open_follows_the_start(camera, lens, points):
    row = dataclasses.replace(points, relation=None, reference=None, weight=jnp.zeros(8).at[0].set(1.0))

    def swing(start):
        tilted = dataclasses.replace(lens, plane=lens.plane.at[0].set(start))
        found = solve(row, camera, tilted, free=("focus", "tilt", "swing"))
        return found.lens.plane[0]

    # One point holds one of three parameters: a part of what the start moves by stays.
    start, step = lens.plane[0], 1e-4
    difference = (swing(start + step) - swing(start - step)) / (2 * step)
    assert 0.25 < float(difference) <= 1.0
    assert np.isfinite(jax.grad(swing)(start))
