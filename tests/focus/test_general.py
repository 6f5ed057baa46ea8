"""The solve of any wishes over any parameters finds what scipy finds, and lens rays confirm it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
import scipy.optimize
from compilations import compilations

from focusjax.focus import (
    AT_LEAST,
    AT_MOST,
    EQUAL,
    SAME,
    AtLeast,
    AtMost,
    AtPoint,
    Blur,
    FocusPoint,
    ImagePoints,
    InDepthRange,
    Prior,
    Result,
    SameBlur,
    Sharp,
    locate,
    solve,
    solve_many,
    stacked,
)
from focusjax.geometry import make_camera
from focusjax.lens import tilt_shift_lens
from focusjax.solvers import JaxoptLBFGSB

NAMES = ("focus", "f_number", "tilt", "swing")
LENGTH = 0.05
FOCAL_PX = LENGTH / 0.036 * 640


@pytest.fixture
def camera():
    return make_camera(jnp.eye(4), width=640, height=480, focal_length=LENGTH)


@pytest.fixture
def lens():
    return tilt_shift_lens(focus_distance=2.0, f_number=4.0, focal_length=LENGTH)


def vector(solution):
    lens = solution.lens
    return np.array([lens.focus_disparity, lens.aperture_radius, lens.plane[1], lens.plane[0]])


def random_problem(seed, *, two_sided):
    """Eight wishes of all kinds over the picture, weights over four decades, and random bounds."""
    rng = np.random.default_rng(seed)
    kinds, odds = ((EQUAL, AT_MOST), (0.7, 0.3))
    if two_sided:
        kinds, odds = ((EQUAL, AT_MOST, AT_LEAST, SAME), (0.5, 0.2, 0.2, 0.1))
    relation = rng.choice(kinds, 8, p=odds)
    signed = (relation == EQUAL) & ((rng.random(8) < 0.5) | (not two_sided))
    target = rng.exponential(15, 8) * (rng.random(8) < 0.7) * (relation != SAME)
    signed |= (target == 0) & (relation == EQUAL)
    target = np.where(signed, target * rng.choice([-1, 1], 8), target)
    points = ImagePoints(
        xy=jnp.asarray(rng.uniform([0, 0], [640, 480], (8, 2))),
        disparity=jnp.asarray(rng.uniform(0, 1.5, 8)),
        target=jnp.asarray(target),
        signed=jnp.asarray(signed),
        weight=jnp.asarray(10.0 ** rng.uniform(-2, 2, 8)),
        tolerance=jnp.ones(8),
        wish=jnp.arange(8),
        names=tuple("abcdefgh"),
        relation=jnp.asarray(relation),
        reference=jnp.asarray(rng.uniform([0, 0, 0], [640, 480, 1.5], (8, 3))),
    )
    limits = {
        "min_focus_distance": rng.uniform(0.5, 1.5),
        "f_number_range": (rng.uniform(1, 4), rng.uniform(4, 16)),
        "tilt_range": tuple(rng.uniform(0, 0.3, 2) * [-1, 1]),
        "swing_range": tuple(rng.uniform(0, 0.3, 2) * [-1, 1]),
    }
    if seed % 3 == 0:
        # The signed blurs are those of one lens.
        blur = blur_of(points.xy, points.disparity, [0.5, 0.005, 0.2, -0.3])
        points = dataclasses.replace(points, target=jnp.where(points.signed, blur, points.target))
    return points, limits


def blur_of(xy, disparity, value):
    """The formula, by hand: 2 f E (u + n_y y + n_x x - w)."""
    tangents = (np.asarray(xy) - [320, 240]) / FOCAL_PX * [1, -1]
    plane = value[0] + value[2] * tangents[:, 1] + value[3] * tangents[:, 0]
    return 2 * FOCAL_PX * value[1] * (plane - np.asarray(disparity))


def by_scipy(points, limits, free, starts, seed):
    """Best cost of several bounded least squares on residuals of its own, and where it is."""
    target, signed, relation = (np.asarray(v) for v in (points.target, points.signed, points.relation))
    root, reference = np.sqrt(np.asarray(points.weight)), np.asarray(points.reference)
    sines = np.sin([limits["tilt_range"], limits["swing_range"]]) / LENGTH
    lower = np.array([0, LENGTH / 2 / limits["f_number_range"][1], -sines[0, 1], sines[1, 0]])
    widest = LENGTH / 2 / limits["f_number_range"][0]
    upper = np.array([1 / limits["min_focus_distance"], widest, -sines[0, 0], sines[1, 1]])
    columns = [NAMES.index(name) for name in free]
    span = (upper - lower)[columns]

    def whole(shares):
        value = np.array([0.5, LENGTH / 8, 0.0, 0.0])
        value[columns] = lower[columns] + shares * span
        return value

    def residual(shares):
        blur = blur_of(points.xy, points.disparity, whole(shares))
        other = blur_of(reference[:, :2], reference[:, 2], whole(shares)) * (relation == SAME)
        miss = np.where(signed, blur - other, abs(blur) - abs(other)) - target
        miss = np.where(relation == AT_MOST, np.maximum(miss, 0), miss)
        return root * np.where(relation == AT_LEAST, np.minimum(miss, 0), miss)

    rng = np.random.default_rng(seed)
    best = None
    for first in [np.full(len(free), 0.5), *rng.uniform(0.01, 0.99, (starts - 1, len(free)))]:
        found = scipy.optimize.least_squares(
            residual, first, bounds=(0, 1), xtol=1e-13, ftol=1e-13, gtol=1e-13, max_nfev=100
        )
        if best is None or found.cost < best.cost:
            best = found
    return best.cost, whole(best.x)


def test_convex_problems_are_solved_as_scipy_solves_them(camera, lens):
    bounds = set()
    for seed in range(24):
        points, limits = random_problem(seed, two_sided=False)
        solution = solve(points, camera, lens, free=NAMES, **limits)
        cost, value = by_scipy(points, limits, NAMES, 1, seed)
        # Observed 3e-8 relative, which is scipy's, whose cost is never lower by more than 1e-9.
        assert float(solution.cost) <= cost * (1 + 1e-8) + 1e-9, seed
        np.testing.assert_allclose(float(solution.cost), cost, rtol=1e-6, atol=1e-6, err_msg=str(seed))
        if solution.result == Result.solved:
            np.testing.assert_allclose(vector(solution), value, rtol=1e-5, atol=2e-5, err_msg=str(seed))
        bounds |= set(solution.active_bounds) or {"inside"}
    assert bounds >= {"inside", "min_tilt", "max_tilt", "min_swing", "max_swing", "min_focus_distance"}


def near(limits):
    """Those of the limits that are to focus and f-number."""
    return {name: value for name, value in limits.items() if name not in ("tilt_range", "swing_range")}


def test_nothing_is_better_where_sides_are_open(camera, lens):
    for seed in range(24):
        points, limits = random_problem(seed, two_sided=True)
        solution = solve(points, camera, lens, free=NAMES[:2], **near(limits))
        cost, _ = by_scipy(points, limits, NAMES[:2], 4, seed)
        # Observed 2e-10 relative.
        assert float(solution.cost) <= cost * (1 + 1e-8) + 1e-9, seed


@pytest.mark.parametrize("seed", [8, 24, 30, *range(6)])
def test_the_sides_of_a_turned_lens_are_found(camera, lens, seed):
    """Twelve blurs that a turned lens gives, without the side of any: no other lens meets them all."""
    rng = np.random.default_rng(seed)
    xy, disparity = rng.uniform([0, 0], [640, 480], (12, 2)), rng.uniform(0, 1.5, 12)
    hidden = [rng.uniform(0.3, 1.2), rng.uniform(0.002, 0.02), *rng.uniform(-4, 4, 2)]
    points = ImagePoints(
        xy=jnp.asarray(xy),
        disparity=jnp.asarray(disparity),
        target=jnp.asarray(np.abs(blur_of(xy, disparity, hidden))),
        signed=jnp.zeros(12, dtype=bool),
        weight=jnp.ones(12),
        tolerance=jnp.ones(12),
        wish=jnp.arange(12),
        names=tuple("abcdefghijkl"),
    )
    found = solve(points, camera, lens, free=NAMES, f_number_range=(1, 22), min_focus_distance=0.5)
    # Without starts through triples of places, costs of 2.1, 10.3 and 0.7 for the first three.
    assert float(found.cost) < 1e-9
    np.testing.assert_allclose(vector(found), hidden, rtol=1e-6)


@pytest.mark.parametrize(
    "solver",
    [
        pytest.param(optx.Dogleg(1e-8, 1e-8), id="dogleg"),
        pytest.param(optx.LevenbergMarquardt(1e-8, 1e-8), id="levenberg-marquardt", marks=pytest.mark.slow),
        pytest.param(optx.BFGS(1e-8, 1e-8), id="bfgs", marks=pytest.mark.slow),
        # Of focus and f-number: test_solve.
        pytest.param(JaxoptLBFGSB(atol=1e-8), id="jaxopt", marks=pytest.mark.slow),
    ],
)
def test_solvers_agree(camera, lens, solver):
    for seed in range(1, 3):
        points, limits = random_problem(seed, two_sided=True)
        first = solve(points, camera, lens, free=NAMES, **limits)
        second = solve(points, camera, lens, free=NAMES, **limits, solver=solver, max_steps=2000, throw=False)
        np.testing.assert_allclose(float(second.cost), float(first.cost), rtol=1e-8)
        np.testing.assert_allclose(vector(second), vector(first), rtol=1e-5, atol=1e-6)


# Of focus alone, and against scipy: test_close_focus and test_solve.
@pytest.mark.slow
def test_many_problems_at_once_are_each_solved(camera, lens):
    problems = [random_problem(seed, two_sided=True)[0] for seed in range(6)]
    many = solve_many(stacked(problems), camera, lens, free=NAMES[:2])
    alone = [solve(points, camera, lens, free=NAMES[:2]) for points in problems]
    # Observed 3e-16 relative.
    np.testing.assert_allclose(many.cost, [float(each.cost) for each in alone], rtol=1e-9)


def test_other_counts_of_wishes_do_not_compile(camera, lens):
    points, limits = random_problem(1, two_sided=True)
    solve(points, camera, lens, free=NAMES[:2], **near(limits))
    fewer = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[:5]), points)
    with compilations() as compiled:
        assert solve(fewer, camera, lens, free=NAMES[:2], **near(limits)).error.shape == (5,)
    assert compiled == []


def sharp(*places, **more):
    return [FocusPoint(AtPoint((x, y, -z)), Sharp(), **more) for x, y, z in places]


THREE = ((-0.4, -0.3, 1.6), (0.1, 0.2, 2.2), (0.9, -0.1, 3.5))


def test_a_plane_through_three_points(camera, lens):
    solution = solve(
        locate(sharp(*THREE), camera), camera, lens, free=("focus", "tilt", "swing"), min_focus_distance=0.5
    )
    # Axes of the plane n.P = 1: X right, Y up, Z forward. Observed 4e-16.
    expected = np.linalg.solve(np.array(THREE), np.ones(3))
    np.testing.assert_allclose(solution.lens.plane, expected, rtol=1e-9)
    np.testing.assert_allclose(solution.error, 0, atol=1e-9)
    # Tilt turns the lens's axis by sin(tilt) = -F n_y.
    moved = solution.lens.movements(camera)
    np.testing.assert_allclose(np.sin(moved.tilt), -LENGTH * expected[1], rtol=1e-9)


def test_one_point_slides_and_turns_the_plane_least(camera, lens):
    """Of all planes through the point the one that changes blur least, in pixels as a shot measures it."""
    place = (0.02, 0.01, 0.8)
    options = {"free": ("focus", "tilt", "swing"), "min_focus_distance": 0.5}
    solution = solve(locate(sharp(place), camera), camera, lens, **options)
    # The slopes of blur at the picture's edge are half its size in focal lengths.
    weights = np.array([640, 480, 2 * FOCAL_PX])
    across = np.array([place[0], place[1], place[2]]) / place[2] / weights
    start = np.array([0, 0, 0.5])
    expected = start + across * (1 / place[2] - 0.5) / (across @ across / 1.0) / weights
    # Observed 1e-15.
    np.testing.assert_allclose(solution.lens.plane, expected, rtol=1e-9)
    assert np.degrees(np.abs(solution.lens.movements(camera).tilt)) < 1.0
    assert solution.undetermined == ("focus", "tilt", "swing")


@pytest.mark.parametrize(
    ("wishes", "options"),
    [
        ([*sharp((0.3, 0.1, 2.5)), FocusPoint(AtPoint((0, 0, -5)), AtLeast(8))], {"free": NAMES[:2]}),
        (sharp(*THREE), {"free": ("focus", "tilt", "swing")}),
        (
            [*sharp(*THREE), FocusPoint(AtPoint((0.3, 0.3, -9)), Blur(15.0))],
            {"free": NAMES, "f_number_range": (0.7, 32.0)},
        ),
        (
            [*sharp((0.3, 0.1, 2.5)), FocusPoint(AtPoint((0, 0, -5)), Blur(9))],
            {"free": ("focus", "focal_length"), "focal_length_range": (0.03, 0.2)},
        ),
    ],
    ids=["f-number", "plane", "all", "zoom"],
)
def test_lens_rays_through_sharp_points_meet(camera, lens, wishes, options):
    solution = solve(locate(wishes, camera), camera, lens, **options)
    assert solution.result in (Result.solved, Result.undetermined)
    pupil = jnp.asarray([[np.cos(a), np.sin(a)] for a in np.linspace(0, 6, 12)])
    points = solution.points
    for index in np.flatnonzero(np.asarray(points.signed)):
        rays = jax.vmap(lambda v, i=index: solution.lens.ray(solution.camera, points.xy[i], v))(pupil)
        landed = np.asarray(rays.at(jnp.broadcast_to(points.disparity[index], (12,))))
        # Observed 1e-12 px.
        assert np.ptp(landed, axis=0).max() < 0.1
    np.testing.assert_allclose(solution.error, 0, atol=1e-6)


class TestZoom:
    def test_keeps_the_f_number_and_moves_the_points(self, camera, lens):
        wishes = [FocusPoint(AtPoint((0.2, 0, -2)), Sharp()), FocusPoint(AtPoint((0.2, 0, -4)), Blur(5.0))]
        solution = solve(
            locate(wishes, camera), camera, lens,
            free=("focus", "focal_length"), focal_length_range=(0.03, 0.2),
        )  # fmt: skip
        zoom = float(solution.camera.focal_length) / LENGTH
        # Blur 2 f E (1/2 - 1/4) with f and E in proportion to the focal length.
        np.testing.assert_allclose(zoom, np.sqrt(5.0 / (2 * FOCAL_PX * LENGTH / 8 * 0.25)), rtol=1e-9)
        np.testing.assert_allclose(solution.lens.f_number(solution.camera), 4.0, rtol=1e-12)
        xy, _ = solution.camera.project(jnp.array([0.2, 0, -4.0]))
        np.testing.assert_allclose(solution.points.xy[1], xy, rtol=1e-12)

    def test_may_keep_the_field_of_view(self, camera, lens):
        wishes = [FocusPoint(AtPoint((0.2, 0, -2)), Sharp()), FocusPoint(AtPoint((0.2, 0, -4)), Blur(5.0))]
        points = locate(wishes, camera)
        solution = solve(
            points, camera, lens, free=("focus", "focal_length"),
            focal_length_range=(0.03, 0.2), keep_field_of_view=True,
        )  # fmt: skip
        np.testing.assert_allclose(solution.camera.focal_px, FOCAL_PX, rtol=1e-12)
        zoom = float(solution.camera.focal_length) / LENGTH
        np.testing.assert_allclose(zoom, 5.0 / (2 * FOCAL_PX * LENGTH / 8 * 0.25), rtol=1e-9)
        np.testing.assert_array_equal(solution.points.xy, points.xy)


class TestPriors:
    def test_one_sigma_costs_a_pixel(self, camera, lens):
        points = locate(sharp((0, 0, 2.0)), camera)
        prior = {"focus": Prior(4.0, sigma=0.1)}
        solution = solve(points, camera, lens, free=("focus",), priors=prior)
        gain = 2 * FOCAL_PX * LENGTH / 8
        expected = (gain**2 * 0.5 + 100 * 0.25) / (gain**2 + 100)
        np.testing.assert_allclose(solution.lens.focus_disparity, expected, rtol=1e-9)

    def test_decide_what_wishes_leave_open(self, camera, lens):
        points = locate(sharp((0, 0, 2.0)), camera)
        priors = {"f_number": Prior(8.0, 1.0), "tilt": Prior(0.1, 0.02), "swing": Prior(-0.05, 0.02)}
        solution = solve(points, camera, lens, free=NAMES, priors=priors)
        assert solution.undetermined == ()
        np.testing.assert_allclose(solution.lens.f_number(camera), 8.0, rtol=1e-9)
        np.testing.assert_allclose(np.sin(0.1), -LENGTH * solution.lens.plane[1], rtol=1e-9)
        np.testing.assert_allclose(np.sin(-0.05), LENGTH * solution.lens.plane[0], rtol=1e-9)


def test_limits_that_are_kept_leave_the_lens_alone(camera, lens):
    wishes = [FocusPoint(AtPoint((0, 0, -2)), AtMost(4.0)), FocusPoint(AtPoint((0, 0, -20)), AtLeast(2.0))]
    solution = solve(locate(wishes, camera), camera, lens, free=NAMES[:2])
    assert set(solution.undetermined) == {"focus", "f_number"}
    np.testing.assert_allclose(vector(solution), [0.5, LENGTH / 8, 0, 0], rtol=1e-9)


def test_a_whole_range_within_its_limit_beside_what_is_unreadable(camera, lens):
    wishes = [
        FocusPoint(InDepthRange(2.0, 2.5, samples=6), AtMost(1.5)),
        FocusPoint(AtPoint((0, 0, -8)), AtLeast(6.0)),
    ]
    solution = solve(locate(wishes, camera), camera, lens, free=NAMES[:2])
    assert all(row.met for row in solution.table())
    # Limits are kept to the pixel, not traded; observed 1e-9.
    np.testing.assert_allclose(solution.error, 0, atol=1e-6)


def test_equal_blur_before_and_behind(camera, lens):
    wishes = [FocusPoint(AtPoint((0, 0, -2)), SameBlur("far")), *sharp((0, 0, 4.0), name="far", weight=0)]
    solution = solve(locate(wishes, camera), camera, lens, free=NAMES[:2])
    # Whatever the f-number, which stays.
    np.testing.assert_allclose(vector(solution), [0.375, LENGTH / 8, 0, 0], rtol=1e-9)


def test_a_wish_without_weight_is_reported_and_not_missed(camera, lens):
    points = locate([*sharp((0, 0, 2.0), name="x"), *sharp((0, 0, 4.0), name="y", weight=0)], camera)
    rows = {row.name: row for row in solve(points, camera, lens).table()}
    assert rows["x"].counts
    assert not rows["y"].counts
    assert abs(rows["y"].got) > 1


def test_two_wishes_of_one_name_are_refused(camera):
    with pytest.raises(ValueError, match="several focus points are called 'x'; give each a name of its own"):
        locate([*sharp((0, 0, 2.0), name="x"), *sharp((0, 0, 4.0), name="x")], camera)
