"""Surfaces through control points: exact, smooth, differentiable, sensible where points are few."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients

from focusjax.lens import FocalSurface, GaussianFade, InverseDistance, WendlandFade, focal_surface

BASES = ("constant", "affine", "quadratic")
KERNELS = {
    "1/d^2": InverseDistance(jnp.array(2.0)),
    "1/d^3": InverseDistance(jnp.array(3.0)),
    "1/d^4": InverseDistance(jnp.array(4.0)),
    "gaussian": GaussianFade(jnp.array(60.0), jnp.array(2.0)),
    "wendland": WendlandFade(jnp.array(150.0), jnp.array(2.0)),
}
LAYOUTS = {
    "one point": [(31.0, 17.5)],
    "collinear": [(10.0, 10.0), (30.0, 20.0), (50.0, 30.0), (90.0, 50.0)],
    "coincident": [(31.0, 17.5), (31.0, 17.5), (80.0, 20.0), (20.0, 70.0)],
    "off screen": [(-300.0, 17.5), (2000.0, 40.0), (50.0, -900.0), (30.0, 20.0)],
    "spread": [(12, 8), (88, 14), (47, 41), (15, 66)],
    "general": [(12, 8), (88, 14), (47, 41), (15, 66), (79, 71), (52, 20), (33, 90)],
}

every_basis = pytest.mark.parametrize("basis", BASES)
FOUR = ("collinear", "coincident", "off screen", "spread")
"""Layouts of as many points share a compilation."""


def pairs(*kernels: str) -> pytest.MarkDecorator:
    """Kernels with the quadratic basis, whose terms are those of the others and more; these with one."""
    cases = [*((kernels[0], basis) for basis in BASES[:2]), *((kernel, "quadratic") for kernel in kernels)]
    return pytest.mark.parametrize(("kernel", "basis"), cases)


def surface(layout: str, kernel: str, basis: str) -> FocalSurface:
    xy = np.array(LAYOUTS[layout], dtype=float)
    number = np.arange(len(xy))
    values = 0.8 + 0.6 * np.sin(2.3 * number + 1)
    return focal_surface(
        xy,
        values,
        aperture_scale=1 + 0.4 * np.cos(number),
        weight=1 + 0.5 * np.sin(number),
        kernel=KERNELS[kernel],
        basis=basis,
    )


@eqx.filter_jit
def at(surface: FocalSurface, places: jnp.ndarray) -> jnp.ndarray:
    """Focal disparity and scale [2, n] at places [n, 2]."""
    return jnp.stack(surface.at(places.T))


@pairs(*KERNELS)
def test_exact_at_control_points_in_float32(kernel, basis):
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), surface("general", kernel, basis))
    found = at(single, single.xy)
    assert found.dtype == jnp.float32
    # Observed: no difference.
    np.testing.assert_allclose(found[0], single.focus_disparity, atol=2e-6)
    np.testing.assert_allclose(found[1], single.aperture_scale, atol=2e-6)


@pytest.mark.parametrize("ratio", [1e-6, 1e6])
def test_exact_at_control_points_of_any_weight(ratio):
    xy = np.array(LAYOUTS["general"])
    weight = np.where(np.arange(len(xy)) % 2, ratio, 1.0)
    made = focal_surface(xy, np.arange(7.0), weight=weight, basis="affine")
    # Observed: 3e-5, light points 35 px from heavy ones: 1e6 x (1e-4 / 35)^2 x differences of values up to 6.
    np.testing.assert_allclose(at(made, made.xy)[0], made.focus_disparity, atol=6e-5)


@pytest.mark.parametrize(
    ("layout", "basis"), [("one point", "affine"), *((layout, "quadratic") for layout in FOUR)]
)
def test_gradients_match_differences(layout, basis):
    """With respect to values, positions, alpha, beta and the place: between points, on one, and far away."""
    made = surface(layout, "1/d^3", basis)
    # The first point is the origin, where differences take steps well below the softening length.
    made = eqx.tree_at(lambda s: s.xy, made, made.xy - made.xy[:1])
    places = jnp.array([(40.3, 33.1), (0.0, 0.0), (-500.0, 300.0)])
    # Contradictory points at one place, pulled 1e-5 px apart, bend the quadratic surface by more than their
    # first order: the differences are off by 7e-4 of the largest slope there, by 2e-5 elsewhere.
    check_gradients(at, made, places, rtol=2e-3 if (layout, basis) == ("coincident", "quadratic") else 1e-4)


@pytest.mark.parametrize(
    ("kernel", "basis"),
    [("1/d^2", "affine"), ("1/d^4", "affine"), ("gaussian", "affine"), ("wendland", "constant")],
)
def test_gradients_of_every_kernel_match_differences(kernel, basis):
    made = surface("off screen", kernel, basis)
    check_gradients(at, made, jnp.array([(40.3, 33.1), LAYOUTS["off screen"][3], (-500.0, 300.0)]), rtol=1e-5)


@pytest.mark.parametrize("layout", ["one point", *FOUR])
def test_finite_with_finite_gradients_in_float32(layout):
    """On points, a hair beside them, and ten thousand pixels away."""
    made = surface(layout, "1/d^4", "quadratic")
    # Points of no weight beside one make four, for which there is a program already.
    added = jnp.array([(90.0, 20.0), (15.0, 60.0), (400.0, 300.0)])[: 4 - len(made.xy)]
    none = jnp.zeros(len(added))
    made = dataclasses.replace(
        made,
        xy=jnp.concatenate([made.xy, added]),
        focus_disparity=jnp.concatenate([made.focus_disparity, none]),
        aperture_scale=jnp.concatenate([made.aperture_scale, none]),
        weight=jnp.concatenate([made.weight, none]),
    )
    xy = made.xy
    places = jnp.concatenate([xy, xy + 1e-4, xy + jnp.array([[0.3, 0.0]]), xy + 1e4])
    made, places = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), (made, places))
    for leaf in jax.tree.leaves(sum_and_gradient(made, places)):
        assert np.isfinite(leaf).all()


@eqx.filter_jit
def sum_and_gradient(made: FocalSurface, places: jnp.ndarray) -> tuple:
    """The sum of all values, which is finite only where every one is, and its slopes."""
    return jax.value_and_grad(lambda both: jnp.sum(jnp.stack(both[0].at(both[1].T))))((made, places))


def test_a_point_of_no_weight_has_no_influence():
    xy, values = np.array(LAYOUTS["general"]), np.arange(7.0)
    without = focal_surface(xy[1:], values[1:], basis="affine")
    muted = focal_surface(xy, values, weight=np.array([0.0, *[1.0] * 6]), basis="affine")
    places = jnp.concatenate([jnp.array(xy), jnp.array([[40.3, 33.1]])])
    np.testing.assert_allclose(at(muted, places), at(without, places), atol=1e-12)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(sum_and_gradient(muted, places)))


@every_basis
def test_contradictory_points_at_one_place_share_it_by_weight(basis):
    made = focal_surface(
        [(31.0, 17.5), (31.0, 17.5), (80.0, 20.0)], [0.2, 1.0, 0.5], weight=[3.0, 1.0, 1.0], basis=basis
    )
    # Observed: 1e-13, and 2e-5 beside the place.
    assert float(at(made, made.xy)[0, 0]) == pytest.approx(0.4, abs=1e-8)
    beside = at(made, made.xy + jnp.array([[0.01, 0.0]]))[0, 0]
    assert float(beside) == pytest.approx(0.4, abs=1e-3)


@pairs("1/d^2", "1/d^3", "1/d^4", "gaussian")
def test_smooth_along_a_line_through_a_control_point(kernel, basis):
    """No jump, kink or spike: slopes change from step to step as they do elsewhere."""
    made = surface("general", kernel, basis)
    middle = made.xy[2]
    for reach in (20.0, 0.2, 2e-3):
        steps = jnp.linspace(-reach, reach, 401)[:, None]
        values = np.asarray(at(made, middle[None] + steps * jnp.array([[0.6, 0.8]]))[0])
        slope = np.diff(values) / (2 * reach / 400)
        # Curvature is bounded, so slopes change by less the finer the steps. Observed: 0.0092 x reach.
        assert np.abs(np.diff(slope)).max() < 0.03 * reach


@every_basis
def test_trends_of_its_degree_are_kept_within_the_points(basis):
    xy = np.array(LAYOUTS["general"])
    x, y = (xy / 100.0).T
    trend = {
        "constant": lambda x, y: 0.7 + 0 * x,
        "affine": lambda x, y: 0.3 + 0.5 * x - 0.8 * y,
        "quadratic": lambda x, y: 0.3 + 0.5 * x - 0.8 * y + 0.4 * x * y - 0.3 * y * y,
    }[basis]
    made = focal_surface(xy, trend(x, y), basis=basis)
    places = np.array([(40.3, 33.1), (60.0, 55.0), (30.0, 50.0)])
    # Observed: 1e-16, 2.5e-7 and 3.7e-6.
    tolerance = {"constant": 1e-12, "affine": 2e-6, "quadratic": 2e-5}[basis]
    np.testing.assert_allclose(at(made, jnp.array(places))[0], trend(*(places / 100.0).T), atol=tolerance)


def test_collinear_points_leave_no_slope_across_their_line():
    made = focal_surface(LAYOUTS["collinear"], [0.2, 0.4, 0.6, 1.0], basis="affine")
    across = jnp.array([[-1.0, 2.0]]) / 5**0.5
    line = jnp.array([[40.0, 25.0]])
    found = at(made, line + jnp.linspace(-15.0, 15.0, 7)[:, None] * across)[0]
    # Observed: within 3e-8 of the value on the line.
    np.testing.assert_allclose(found, 0.5, atol=1e-6)


@pytest.mark.parametrize("basis", ["affine", "quadratic"])
def test_points_that_become_collinear_change_the_surface_without_a_jump(basis):
    place = jnp.array([[45.0, 35.0]])

    def value(bend: float) -> float:
        xy = np.array(LAYOUTS["collinear"])
        xy[1] += bend * np.array([-1.0, 2.0])
        return float(at(focal_surface(xy, [0.2, 0.7, 0.6, 1.0], basis=basis), place)[0, 0])

    bends = np.linspace(-4.0, 4.0, 161)
    values = np.array([value(bend) for bend in bends])
    # Steps of 0.05 x 2.2 px. Observed: 0.027 at most from one to the next, of 0.8 in all.
    assert np.abs(np.diff(values)).max() < 0.05
    assert np.abs(np.diff(values, 2)).max() < 3e-3


@every_basis
def test_a_point_that_fades_out_leaves_without_a_jump(basis):
    xy, values = np.array(LAYOUTS["general"]), 0.8 + 0.6 * np.sin(np.arange(7))
    place = jnp.array([[40.3, 33.1]])

    def value(alpha: float) -> float:
        return float(at(focal_surface(xy, values, weight=[alpha, *[1.0] * 6], basis=basis), place)[0, 0])

    gone = value(0.0)
    misses = [abs(value(alpha) - gone) for alpha in (1e-3, 1e-6)]
    # Observed: 0.011 for the quadratic, less for the others, and in proportion to alpha.
    assert misses[0] < 0.02
    assert misses[1] < 1.1e-3 * misses[0]


@pytest.mark.parametrize("basis", ["affine", "quadratic"])
def test_far_from_two_close_points_the_surface_levels_off(basis):
    """A plane through points 1 px apart would be at 2,000 here."""
    made = focal_surface([(50.0, 50.0), (51.0, 50.0)], [0.0, 1.0], basis=basis)
    # Observed: 0.56 and 0.69.
    assert abs(float(at(made, jnp.array([[2050.0, 50.0]]))[0, 0])) < 5.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"xy": np.zeros((0, 2))}, "at least one"),
        ({"xy": [(0.0, np.nan)]}, "position is nan"),
        ({"focus_disparity": [0.1, 0.2]}, "expected one number, or 1"),
        ({"focus_disparity": np.inf}, "focus disparity is inf; expected a finite number"),
        ({"aperture_scale": -0.5}, "aperture scale is -0.5; expected a finite number of at least 0"),
        ({"weight": 0.0}, "every control point has weight 0"),
    ],
)
def test_bad_control_points_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        focal_surface(**{"xy": [(1.0, 2.0)], "focus_disparity": 0.5, **arguments})
