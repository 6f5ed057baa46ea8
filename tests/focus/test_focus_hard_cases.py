"""Scenes that break focus solvers: a right answer or a named status, and the same in float32."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import AtInfinity, AtLeast, AtPoint, Blur, FocusPoint, Result, Sharp, locate, solve
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens

PLANE = ("focus", "tilt", "swing")
BOTH = ("focus", "f_number")
ALL = (*BOTH, "tilt", "swing")


def at(x, y, z, wish=None, **more):
    where = AtInfinity((x, y, -1.0)) if z == np.inf else AtPoint((x * z, y * z, -z))
    return FocusPoint(where, Sharp() if wish is None else wish, **more)


def solved(wishes, free, *, focal_length=0.05, f_number=4.0, focus=2.0, scale=1.0, **options):
    camera = make_camera(
        jnp.eye(4), width=640, height=480, focal_length=focal_length * scale, sensor_width=0.036 * scale
    )
    lens = thin_lens(focus_distance=focus * scale, f_number=f_number, focal_length=focal_length * scale)
    return solve(locate(wishes, camera), camera, lens, free=free, **options)


def both_precisions(wishes, free, *, at_bound=False, **more):
    """The float64 solution, after a check that float32 comes to the same verdict and nothing is NaN.

    Where what is wished for is `at_bound`, rounding decides whether the bound holds it there.
    """
    exact = solved(wishes, free, **more)
    with jax.enable_x64(False):
        single = solved(wishes, free, **more)
    assert single.result == exact.result
    assert at_bound or single.active_bounds == exact.active_bounds
    assert single.undetermined == exact.undetermined
    size = float(np.abs(np.asarray(exact.blur)).max())
    # Observed 3e-5 of the largest blur.
    np.testing.assert_allclose(single.error, exact.error, atol=1e-3 * max(size, 1.0))
    for leaf in jax.tree.leaves((exact.lens, single.lens)):
        assert np.isfinite(leaf).all()
    return exact


SPREAD = ((-0.2, -0.1), (0.2, 0.1), (-0.1, 0.2), (0.15, -0.15))


def test_all_points_at_infinity():
    found = both_precisions([at(x, y, np.inf) for x, y in SPREAD], PLANE, at_bound=True)
    np.testing.assert_allclose(found.lens.plane, 0.0, atol=1e-12)
    assert found.result == Result.solved


def test_infinity_and_a_near_point_together():
    found = both_precisions([at(0.2, 0, np.inf), at(0, 0.1, np.inf), at(-0.2, -0.1, 1.0)], PLANE)
    np.testing.assert_allclose(found.error, 0, atol=1e-9)


def test_focus_at_the_minimum_distance():
    found = both_precisions([at(x, y, 0.5) for x, y in SPREAD], PLANE, min_focus_distance=0.5)
    np.testing.assert_allclose(found.lens.plane, [0, 0, 2.0], atol=1e-9)
    nearer = both_precisions([at(x, y, 0.4) for x, y in SPREAD], PLANE, min_focus_distance=0.5)
    assert nearer.active_bounds == ("min_focus_distance",)


def test_all_wishes_contradictory():
    wishes = [at(0, 0, 2, Blur(size, signed=True)) for size in (-20, 0, 20)] + [at(0, 0, 2, AtLeast(30.0))]
    found = both_precisions(wishes, BOTH)
    # Two of the four pull to the far side, two to the near one, AtLeast the harder.
    assert found.result in (Result.solved, Result.undetermined)
    assert not any(row.met for row in found.table())


def test_fewer_wishes_than_parameters():
    found = both_precisions([at(0.1, 0.1, 3)], ALL)
    assert found.result == Result.undetermined
    np.testing.assert_allclose(found.error, 0, atol=1e-9)


def test_duplicated_points():
    once = both_precisions([at(x, y, z) for (x, y), z in zip(SPREAD, (1, 2, 3, 4), strict=True)], PLANE)
    twice = both_precisions([at(x, y, z) for (x, y), z in zip(SPREAD, (1, 2, 3, 4), strict=True)] * 2, PLANE)
    np.testing.assert_allclose(twice.lens.plane, once.lens.plane, rtol=1e-9)


def test_points_on_a_line_through_the_lens():
    found = both_precisions([at(0.1, 0.1, z) for z in (1, 2, 4)], PLANE)
    # One place in the picture: only its focal disparity is determined, as the mean.
    assert found.undetermined == PLANE
    np.testing.assert_allclose(found.error.sum(), 0, atol=1e-9)


def test_plane_parallel_to_the_view_axis():
    table = [at(x / z, -0.3 / z, z) for x, z in ((-0.2, 1), (0.3, 1.5), (-0.4, 2), (0.5, 3))]
    found = both_precisions(table, PLANE)
    # n.P = 1 for Y = -0.3 m; the view axis meets it at infinity, which is where the focus may just be.
    np.testing.assert_allclose(found.lens.plane, [0, -1 / 0.3, 0], atol=1e-9)
    np.testing.assert_allclose(found.error, 0, atol=1e-9)


@pytest.mark.parametrize(("focal_length", "distance"), [(0.6, 30.0), (0.002, 0.3)], ids=["600 mm", "2 mm"])
def test_extremely_long_lens_and_phone_lens(focal_length, distance):
    size = 0.02 / focal_length * 0.05
    wishes = [
        at(size * x, size * y, distance * z) for (x, y), z in zip(SPREAD, (1, 1.1, 1.2, 1.05), strict=True)
    ]
    found = both_precisions(wishes, PLANE, focal_length=focal_length, focus=distance)
    assert found.result in (Result.solved, Result.undetermined)


@pytest.mark.parametrize("f_number", [0.5, 64.0])
def test_f_half_and_f_sixty_four(f_number):
    wishes = [at(0, 0, 2), at(0.1, 0, 4, Blur(5.0, signed=True))]
    found = both_precisions(wishes, ALL, f_number=f_number, f_number_range=(0.5, 64.0))
    np.testing.assert_allclose(found.error, 0, atol=1e-8)


@pytest.mark.parametrize("scale", [1e-3, 1e4], ids=["1 mm", "10 km"])
def test_scene_scales(scale):
    """The whole world scaled, lens and all, has the same picture."""
    wishes = [at(x, y, z) for (x, y), z in zip(SPREAD, (1, 2, 3, 4), strict=True)]
    plain = both_precisions(wishes, PLANE, min_focus_distance=0.5)
    scaled_wishes = [at(x, y, z * scale) for (x, y), z in zip(SPREAD, (1, 2, 3, 4), strict=True)]
    found = both_precisions(scaled_wishes, PLANE, scale=scale, min_focus_distance=0.5 * scale)
    np.testing.assert_allclose(found.error, plain.error, atol=1e-8)


def test_weights_from_a_millionth_to_a_million():
    wishes = [
        at(x, y, z, weight=weight)
        for (x, y), z, weight in zip(SPREAD, (1, 2, 3, 4), (1e6, 1e6, 1e6, 1e-6), strict=True)
    ]
    found = solved(wishes, PLANE, min_focus_distance=0.5)
    np.testing.assert_allclose(found.error[:3], 0, atol=1e-9)


def test_unsigned_blur_with_two_valleys_of_equal_cost():
    wishes = [at(0, 0, 2, Blur(4.0)), at(0.1, 0.1, 2, AtLeast(1.0))]
    found = both_precisions(wishes, ("focus",), focus=5.0)
    assert found.result == Result.solved
    # Of two equal valleys the one that changes the picture less.
    assert float(found.lens.focus_disparity) < 0.5
    np.testing.assert_allclose(found.error, 0, atol=1e-9)
