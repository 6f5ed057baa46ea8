"""The plane in focus through any number of points: exact, least squares, on its bounds, and left open."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients
from jaxtyping import Array, Int
from scipy.optimize import minimize
from tilted_thin_lens import TracedLens

from focusjax.focus import PlaneFit, fit_focal_plane
from focusjax.geometry import Camera, make_camera
from focusjax.lens import TiltShiftLens, thin_lens, tilt_shift_lens

LENGTH = 0.09
WIDTH, HEIGHT = 600, 400
DEGREE = np.pi / 180


def camera_of(length: float = LENGTH) -> Camera:
    """At the origin, looking along -z; 48 degrees across whatever the focal length."""
    return make_camera(np.eye(4), width=WIDTH, height=HEIGHT, focal_length=length, sensor_width=0.9 * length)


CAMERA = camera_of()
START = tilt_shift_lens(focus_distance=3.0, tilt=0.02, swing=-0.01, f_number=2.8, focal_length=LENGTH)
XY = np.array([(80.0, 350.0), (520.0, 300.0), (310.0, 60.0), (200.0, 200.0), (420.0, 120.0)])
DISPARITY = np.array([0.70, 0.55, 0.22, 0.40, 0.27])
"""A slanted row of things, nearly in a plane: the lower the nearer."""


def fit(xy=XY, disparity=DISPARITY, lens=START, camera=CAMERA, **options) -> PlaneFit:
    arrays = {"xy": xy, "disparity": disparity} | {
        k: options.pop(k) for k in ("weight", "blur") if k in options
    }
    given = {name: jnp.asarray(value, dtype=lens.plane.dtype) for name, value in arrays.items()}
    return fit_focal_plane(given.pop("xy"), given.pop("disparity"), camera, lens, **given, **options)


def views(xy: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    """Rows (x, y, 1) of view tangents."""
    away = (np.asarray(xy) - np.asarray(camera.principal_point)) / float(camera.focal_px)
    return np.column_stack([away * [1, -1], np.ones(len(away))])


def span(lens: TiltShiftLens, camera: Camera = CAMERA) -> float:
    return 2 * float(camera.focal_px * lens.aperture_radius)


def in_precision(tree, precision):
    return jax.tree.map(lambda a: a.astype(precision), tree)


@pytest.mark.parametrize("precision", [jnp.float64, jnp.float32])
def test_three_points_are_met_exactly(precision):
    found = fit(XY[:3], DISPARITY[:3], in_precision(START, precision), in_precision(CAMERA, precision))
    expected = np.linalg.solve(views(XY[:3]), DISPARITY[:3])
    # Observed: 6e-17 1/m in float64, 5e-8 in float32; 2e-15 and 3e-7 pixels.
    tolerance = 1e-9 if precision == jnp.float64 else 1e-4
    assert found.plane.dtype == precision
    np.testing.assert_allclose(found.plane, expected, atol=tolerance)
    np.testing.assert_allclose(found.residual, 0.0, atol=10 * tolerance)
    assert (found.undetermined, found.active_bounds) == ("", ())


def test_blur_of_the_fitted_lens_is_the_residual():
    blur = np.array([3.0, -2.0, 0.0, 5.0, 1.0])
    found = fit(blur=blur)
    got = [
        float(found.lens.blur(CAMERA, jnp.array(p), jnp.array(w))) for p, w in zip(XY, DISPARITY, strict=True)
    ]
    # Observed: 2e-15 pixels.
    np.testing.assert_allclose(found.residual, got - blur, atol=1e-9)
    assert float(found.cost) == pytest.approx(0.5 * (found.residual**2).sum())


def test_three_wanted_blurs_are_met_exactly():
    found = fit(XY[:3], DISPARITY[:3], blur=[4.0, -7.0, 2.5])
    got = [
        float(found.lens.blur(CAMERA, jnp.array(p), jnp.array(w)))
        for p, w in zip(XY[:3], DISPARITY[:3], strict=True)
    ]
    np.testing.assert_allclose(got, [4.0, -7.0, 2.5], atol=1e-9)


@pytest.mark.parametrize("count", [3, 5])
def test_it_is_weighted_least_squares(count: int):
    weight = np.array([1.0, 4.0, 0.5, 2.0, 0.0])[:count]
    found = fit(XY[:count], DISPARITY[:count], weight=weight)
    root = np.sqrt(weight)
    expected, *_ = np.linalg.lstsq(root[:, None] * views(XY[:count]), root * DISPARITY[:count])
    # Observed: 7e-16 1/m.
    np.testing.assert_allclose(found.plane, expected, atol=1e-12)


def reference(k, rows, target, weight, reach, most) -> float:
    """The least cost within the bounds by scipy's SLSQP, in units of the bounds, from several starts."""
    size = np.array([reach, reach, most])
    scaled = k * np.sqrt(weight)[:, None] * rows * size
    aim = k * np.sqrt(weight) * target
    unit = 1 / (aim @ aim)
    bounds = [
        {
            "type": "ineq",
            "fun": lambda m: 1 - m[:2] @ m[:2],
            "jac": lambda m: np.array([-2 * m[0], -2 * m[1], 0]),
        },
        {"type": "ineq", "fun": lambda m: 1 - m[2], "jac": lambda m: np.array([0.0, 0.0, -1.0])},
    ]
    best = np.inf
    for angle in (0, 2, 4):
        run = minimize(
            lambda m: unit * ((scaled @ m - aim) ** 2).sum(),
            np.array([0.5 * np.cos(angle), 0.5 * np.sin(angle), 0.5]),
            jac=lambda m: 2 * unit * scaled.T @ (scaled @ m - aim),
            constraints=bounds,
            method="SLSQP",
            options={"maxiter": 300, "ftol": 1e-13},
        )
        if run.x[2] <= 1 + 1e-7 and run.x[:2] @ run.x[:2] <= 1 + 1e-7:
            best = min(best, run.fun / unit)
    return best


def test_random_problems_on_and_off_their_bounds_are_as_good_as_scipys():
    random = np.random.default_rng(3)
    limited = [0, 0, 0, 0]
    for _ in range(60):
        count = 6
        xy = random.uniform([0, 0], [WIDTH, HEIGHT], (count, 2))
        disparity = random.uniform(0.0, 1.2, count)
        weight = random.uniform(0.1, 3.0, count)
        max_tilt, nearest = random.uniform(0.005, 0.2), 1 / random.uniform(0.3, 1.2)
        found = fit(xy, disparity, weight=weight, max_tilt=max_tilt, min_focus_distance=nearest)
        plane, reach = np.asarray(found.plane), np.sin(max_tilt) / LENGTH
        assert np.hypot(*plane[:2]) <= reach * (1 + 1e-12)
        assert plane[2] <= (1 + 1e-12) / nearest
        best = reference(span(START), views(xy), disparity, weight, reach, 1 / nearest)
        # Observed: the same to 5e-13.
        assert 2 * float(found.cost) == pytest.approx(best, rel=1e-8)
        limited[int(found.tilt_limited) + 2 * int(found.focus_limited)] += 1
    # Every combination of bounds comes up. Observed: 19, 24, 7 and 10 times.
    assert min(limited) >= 2, limited


class Fit(eqx.Module):
    """Plane and residuals of the first `count` points; compiled once for all counts."""

    count: Int[Array, ""]

    def __call__(self, xy, disparity, weight, blur, camera, lens, max_tilt, nearest):
        weight = jnp.where(jnp.arange(weight.size) < self.count, weight, 0.0)
        found = fit_focal_plane(
            xy, disparity, camera, lens,
            weight=weight, blur=blur, max_tilt=max_tilt, min_focus_distance=nearest,
        )  # fmt: skip
        return found.plane, found.residual


@pytest.mark.parametrize(
    ("count", "max_tilt", "nearest", "bounds"),
    [
        pytest.param(5, 0.7, 0.3, (), id="inside"),
        pytest.param(5, 0.03, 0.3, ("max_tilt",), id="on the tilt limit"),
        pytest.param(5, 0.7, 3.1, ("min_focus_distance",), id="on the focus limit"),
        pytest.param(5, 0.03, 3.1, ("max_tilt", "min_focus_distance"), id="on both"),
        pytest.param(2, 0.7, 0.3, (), id="two points"),
        pytest.param(2, 0.02, 0.3, ("max_tilt",), id="two points on the tilt limit"),
    ],
)
def test_gradients_match_differences(count, max_tilt, nearest, bounds):
    """In the points, weights, wanted blur, camera, lens and bounds."""
    xy, disparity = jnp.array(XY), jnp.array(DISPARITY)
    weight, blur = jnp.array([1.0, 2.0, 0.7, 1.5, 0.4]), jnp.array([2.0, 0.0, -3.0, 1.0, 0.0])
    arguments = (xy, disparity, weight, blur, CAMERA, START, jnp.array(max_tilt), jnp.array(nearest))
    given = [array[:count] for array in (xy, disparity)]
    limits = {"max_tilt": max_tilt, "min_focus_distance": nearest}
    found = fit(*given, weight=weight[:count], blur=blur[:count], **limits)
    assert found.active_bounds == bounds
    # Observed: 3.4e-7 of the largest for two points, up to 2e-7 elsewhere.
    check_gradients(Fit(jnp.array(count)), *arguments)


@pytest.mark.parametrize("precision", [jnp.float64, jnp.float32])
@pytest.mark.parametrize("far", [1.0, 0.6])
def test_points_on_a_line_leave_the_tilt_about_it(far: float, precision):
    """They are met, and of all planes that hold them the nearest to the given one over the frame is taken."""
    share = np.array([0.0, 0.4, far, 0.4])[:, None]
    xy = (1 - share) * [(100.0, 300.0)] + share * [(500.0, 90.0)]
    disparity = (0.6 + share * (0.25 - 0.6))[:, 0]
    lens, camera = in_precision((START, CAMERA), precision)
    found = fit(xy, disparity, lens, camera)
    assert found.undetermined == "tilt about the line through the points is undetermined"
    # Observed: 1e-15 and 6e-7 pixels.
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-9 if precision == jnp.float64 else 1e-4)
    change = np.asarray(found.plane - lens.plane)
    open_turn = np.cross(*views(xy[:2]))
    over_frame = views(
        np.array([(x, y) for x in np.arange(WIDTH) + 0.5 for y in np.arange(HEIGHT) + 0.5][::7])
    )
    across = over_frame @ change @ (over_frame @ open_turn)
    size = np.linalg.norm(over_frame @ change) * np.linalg.norm(over_frame @ open_turn)
    # Observed: 7e-6, by which sampled pixels differ from the whole frame.
    assert abs(across) < 1e-4 * size


def test_one_point_slides_and_turns_the_plane_least():
    found = fit(XY[:1], DISPARITY[:1])
    assert found.undetermined == "tilt and swing are undetermined: all points are seen at one place"
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-10)
    middle = fit(np.array([(300.0, 200.0)]), DISPARITY[:1])
    # In the middle of the frame a change of distance is least.
    np.testing.assert_allclose(middle.plane[:2], START.plane[:2], atol=1e-14)


def test_points_without_weight_are_only_reported():
    found = fit(weight=np.zeros(5))
    assert found.undetermined == "the plane is undetermined: no point has weight"
    np.testing.assert_allclose(found.plane, START.plane)
    assert float(found.cost) == 0.0


def test_a_tilt_about_the_line_is_used_to_stay_within_the_limit():
    """The nearest plane through two points is too steep, but another through both is not."""
    steep = tilt_shift_lens(focus_distance=3.0, tilt=0.10, f_number=2.8, focal_length=LENGTH)
    xy, disparity = np.array([(100.0, 150.0), (500.0, 150.0)]), np.array([0.5, 0.4])
    free = fit(xy, disparity, steep)
    tilt = np.arcsin(LENGTH * np.hypot(*np.asarray(free.plane)[:2]))
    held = fit(xy, disparity, steep, max_tilt=tilt / 2)
    assert held.active_bounds == ("max_tilt",)
    # Observed: 3e-7 pixels, what is left of the stiffness of the open turn.
    np.testing.assert_allclose(held.residual, 0.0, atol=1e-5)
    assert np.hypot(*np.asarray(held.plane)[:2]) == pytest.approx(np.sin(tilt / 2) / LENGTH)


def test_points_on_a_line_through_the_lens():
    """One place in the picture, two distances: the disparity between them is best, and tilt stays."""
    found = fit(np.array([XY[0], XY[0]]), np.array([0.7, 0.3]))
    assert found.undetermined == "tilt and swing are undetermined: all points are seen at one place"
    half = 0.2 * span(START)
    np.testing.assert_allclose(found.residual, [-half, half], atol=1e-9)


@pytest.mark.parametrize("precision", [jnp.float64, jnp.float32])
def test_all_points_at_infinity(precision):
    lens, camera = in_precision((START, CAMERA), precision)
    found = fit(XY, np.zeros(5), lens, camera)
    # Observed: 1e-17 and 9e-8 1/m.
    np.testing.assert_allclose(found.plane, 0.0, atol=1e-9 if precision == jnp.float64 else 1e-5)
    assert (found.undetermined, found.active_bounds) == ("", ())


def test_duplicated_points_change_nothing():
    once = fit(weight=2 * np.ones(5))
    twice = fit(np.tile(XY, (2, 1)), np.tile(DISPARITY, 2))
    np.testing.assert_allclose(twice.plane, once.plane, atol=1e-13)


def test_order_and_scale_of_weights_change_nothing():
    weight = np.array([1e-6, 1e6, 3.0, 1e6, 1e-3])
    found = fit(weight=weight)
    order = [3, 1, 4, 0, 2]
    moved = fit(XY[order], DISPARITY[order], weight=1e3 * weight[order])
    # Observed: 2e-16 1/m.
    np.testing.assert_allclose(moved.plane, found.plane, atol=1e-9)


@pytest.mark.parametrize("precision", [jnp.float64, jnp.float32])
def test_weights_from_1e_minus_6_to_1e6_still_meet_three_points(precision):
    lens, camera = in_precision((START, CAMERA), precision)
    found = fit(XY[:3], DISPARITY[:3], lens, camera, weight=[1e-6, 1e6, 1.0])
    # Observed: 3e-15 and 4e-7 pixels.
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-9 if precision == jnp.float64 else 1e-4)
    assert (found.undetermined, found.active_bounds) == ("", ())


HARD = {
    "plane parallel to the view axis": (0.09, 4.0, 1.5, (0.0, 1.0, 0.0)),
    "600 mm": (0.6, 2.8, 20.0, (0.3, 1.0, -0.5)),
    "phone, 2 mm": (0.002, 2.0, 0.3, (0.05, 1.0, -3.0)),
    "f 0.5": (0.05, 0.5, 1.0, (0.2, 1.0, -0.7)),
    "f 64": (0.05, 64.0, 1.0, (0.2, 1.0, -0.7)),
    "scene of 1 mm": (0.0001, 4.0, 0.001, (0.1, 1.0, -0.5)),
    "scene of 10 km": (0.09, 4.0, 1e4, (0.1, 1.0, -0.5)),
}


@pytest.mark.parametrize("precision", [jnp.float64, jnp.float32])
@pytest.mark.parametrize(("length", "f_number", "scale", "normal"), HARD.values(), ids=HARD)
def test_light_from_every_fitted_point_meets_on_the_film(length, f_number, scale, normal, precision):
    """Traced through the tilted thin lens: rays land within 0.1 px of where the camera sees the point."""
    camera = camera_of(length)
    xy = np.array([(90.0, 380.0), (500.0, 330.0), (330.0, 250.0)])
    # On the plane through (0, -0.5, 0.3) of the scale, with the normal given.
    rows = views(xy, camera)
    plane = np.array(normal) / (np.array(normal) @ [0.0, -0.5, 0.3]) / scale
    disparity = rows @ plane
    assert (disparity > 0).all()
    start = tilt_shift_lens(focus_distance=scale, focal_length=length, f_number=f_number)
    lens, narrow = in_precision((start, camera), precision)
    found = fit(xy, disparity, lens, narrow)
    assert (found.undetermined, found.active_bounds) == ("", ())
    moves = found.lens.movements(narrow)
    tilt, swing = float(moves.tilt), float(moves.swing)
    axis = np.array([np.cos(tilt) * np.sin(swing), -np.sin(tilt), np.cos(tilt) * np.cos(swing)])
    glass = TracedLens(axis, length, float(moves.image_distance))
    for view, w, place in zip(rows, disparity, xy, strict=True):
        tangents = glass.onto_film(view / w, glass.opening(length / (2 * f_number)))
        landed = np.asarray(camera.principal_point) + float(camera.focal_px) * tangents * [1, -1]
        # Observed: 3e-13 pixels in float64, 9e-6 in float32.
        tolerance = 1e-9 if precision == jnp.float64 else 1e-3
        np.testing.assert_allclose(landed, np.broadcast_to(place, landed.shape), atol=tolerance)


def test_a_plane_nearly_through_the_lens_centre_is_limited_and_says_so():
    """Points of a plane that passes 1 cm below a 90 mm lens, which no tilt reaches."""
    xy = np.array([(90.0, 380.0), (500.0, 330.0), (330.0, 250.0)])
    found = fit(xy, views(xy) @ [0.0, -100.0, 0.0])
    assert "max_tilt" in found.active_bounds
    assert float(found.lens.movements(CAMERA).tilt) <= 45 * DEGREE + 1e-9
    assert np.isfinite(np.asarray(found.residual)).all()
    assert np.abs(found.residual).max() > 1.0


def test_a_thin_lens_is_a_start_too():
    start = thin_lens(focus_distance=3.0, f_number=2.8, focal_length=LENGTH)
    np.testing.assert_allclose(fit(lens=as_start(start)).plane, fit().plane, atol=1e-13)


def as_start(lens):
    return fit_focal_plane(jnp.array(XY), jnp.array(DISPARITY), CAMERA, lens).lens


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"xy": np.zeros((0, 2)), "disparity": np.zeros(0)}, "there are no points to fit a plane to"),
        ({"disparity": -DISPARITY}, "a point's disparity is -0.7; expected 0"),
        ({"weight": [1, 1, np.nan, 1, 1]}, "a point's weight is nan; expected zero or a positive number"),
        ({"blur": [1, 1, np.inf, 1, 1]}, "a wanted blur is inf; expected a finite number of pixels"),
        ({"max_tilt": 1.6}, "the tilt limit in radians is 1.6; expected 0 up to less than pi/2"),
        (
            {"min_focus_distance": 0.09},
            "minimum focus distance in metres is 0.09; expected a finite distance",
        ),
        (
            {"lens": eqx.tree_at(lambda lens: lens.aperture_radius, START, jnp.array(0.0))},
            "a pinhole is sharp everywhere, so open the lens",
        ),
    ],
)
def test_bad_problems_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        fit(**changes)
