"""The solve finds the best lens of all, keeps to its bounds, and says what it could not know."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from compilations import compilations

from focusjax.focus import ImagePoints, Result, solve, solve_many, stacked
from focusjax.solvers import JaxoptLBFGSB

BOTH = ("focus", "f_number")
# Blur per metre of aperture radius and dioptre for the fixture's camera: 2 f = 2 * 50 / 36 * 640 px.
SLOPE = 2 * 0.05 / 0.036 * 640


def parameters(solution):
    return np.array([solution.lens.focus_disparity, solution.lens.aperture_radius])


class TestClosedForms:
    def test_one_sharp_point(self, make_setup, make_points):
        camera, lens = make_setup()
        solution = solve(make_points((0.4, 0.0, True, 1)), camera, lens)
        np.testing.assert_allclose(float(solution.lens.focus_distance()), 2.5, rtol=1e-12)
        assert solution.result == Result.solved
        assert solution.active_bounds == ()

    def test_sharp_points_meet_at_their_weighted_mean_disparity(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points((0.2, 0, True, 3), (1.0, 0, True, 1), (0.5, 0, True, 0))
        solution = solve(points, camera, lens)
        np.testing.assert_allclose(solution.lens.focus_disparity, 0.4, rtol=1e-12)

    def test_a_signed_blur_gives_focus(self, make_setup, make_points):
        camera, lens = make_setup()
        solution = solve(make_points((0.4, -5.0, True, 1)), camera, lens)
        expected = 0.4 - 5 / (SLOPE * lens.aperture_radius)
        np.testing.assert_allclose(solution.lens.focus_disparity, expected, rtol=1e-12)

    def test_two_blurs_give_focus_and_f_number(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points((0.5, 0, True, 1), (0.25, 10.0, False, 1), (0.75, 10.0, False, 1))
        solution = solve(points, camera, lens, free=BOTH)
        np.testing.assert_allclose(parameters(solution), [0.5, 10 / (SLOPE * 0.25)], rtol=1e-12)
        np.testing.assert_allclose(solution.error, 0, atol=1e-10)
        assert all(line.met for line in solution.table())


class TestInfinity:
    def test_all_sharp_at_infinity(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points((0.0, 0, True, 1), (0.0, 0, True, 1), (0.0, 0, True, 1))
        solution = solve(points, camera, lens)
        assert float(solution.lens.focus_disparity) == 0.0
        assert np.isinf(float(solution.lens.focus_distance()))
        assert solution.active_bounds == ()

    def test_a_finite_limit_holds(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points((0.0, 0, True, 1), (0.0, 0, True, 1), (0.0, 0, True, 1))
        solution = solve(points, camera, lens, max_focus_distance=100.0)
        assert float(solution.lens.focus_disparity) == 1 / 100.0
        assert solution.active_bounds == ("max_focus_distance",)

    def test_infinity_and_a_near_point(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points((0.0, 0, True, 1), (2.0, 0, True, 1), (0.0, 0, True, 0))
        solution = solve(points, camera, lens)
        np.testing.assert_allclose(solution.lens.focus_disparity, 1.0, rtol=1e-12)
        # The distance of a point at infinity is reported as such.
        assert solution.table()[0].distance == np.inf


class TestBounds:
    def test_a_point_too_near_is_missed_by_the_minimum_distance(self, make_setup, make_points):
        camera, lens = make_setup()
        solution = solve(make_points((2.0, 0, True, 1)), camera, lens, min_focus_distance=0.7)
        assert float(solution.lens.focus_disparity) == float(1 / jnp.asarray(0.7))
        assert solution.active_bounds == ("min_focus_distance",)
        assert not solution.table()[0].met

    def test_a_point_at_the_minimum_distance_is_not_held_back_by_it(self, make_setup, make_points):
        camera, lens = make_setup()
        solution = solve(make_points((2.0, 0, True, 1)), camera, lens, min_focus_distance=0.5)
        # Observed: 1 rounding.
        np.testing.assert_allclose(float(solution.lens.focus_disparity), 2.0, rtol=1e-15)
        assert solution.active_bounds == ()

    @pytest.mark.parametrize(
        ("targets", "f_number", "name"), [((0, 0), 32.0, "max_f_number"), ((0, 90), 1.0, "min_f_number")]
    )
    def test_f_number_stops_exactly_at_the_end_of_its_range(
        self, make_setup, make_points, targets, f_number, name
    ):
        camera, lens = make_setup()
        points = make_points((0.5, targets[0], True, 1), (0.25, targets[1], False, 1), (0.1, 0, True, 0))
        solution = solve(points, camera, lens, free=BOTH)
        assert float(solution.lens.aperture_radius) == float(camera.focal_length / (2 * f_number))
        assert solution.active_bounds == (name,)

    def test_both_bounds_at_once(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points((0.5, 300.0, True, 1), (0.25, 350.0, True, 1), (0.1, 0, True, 0))
        solution = solve(points, camera, lens, free=BOTH, min_focus_distance=0.6)
        assert solution.active_bounds == ("min_focus_distance", "min_f_number")
        expected = [float(1 / jnp.asarray(0.6)), float(camera.focal_length / 2)]
        assert parameters(solution).tolist() == expected

    def test_the_end_of_the_range_is_a_legal_start(self, make_setup, make_points):
        camera, lens = make_setup(f_number=2.8)
        points = make_points((0.5, 0, True, 1))
        solution = solve(points, camera, lens, free=BOTH, f_number_range=(2.8, 11.0))
        # Any f-number keeps one plane sharp, so the start is kept.
        np.testing.assert_allclose(parameters(solution), [0.5, float(lens.aperture_radius)], rtol=1e-7)


def random_problem(seed):
    """Wishes of all kinds at six disparities, with weights over six decades, and random bounds."""
    rng = np.random.default_rng(seed)
    signed = rng.random(6) < 0.5
    sharp = rng.random(6) < 0.3
    target = np.where(sharp, 0.0, np.where(signed, rng.normal(0, 20, 6), rng.exponential(20, 6)))
    rows = zip(
        rng.uniform(0, 2, 6), target, (signed | sharp).tolist(), 10.0 ** rng.uniform(-3, 3, 6), strict=True
    )
    return list(rows), random_limits(rng)


def random_limits(rng):
    near = rng.uniform(0.3, 1.5)
    return {
        "min_focus_distance": near,
        "max_focus_distance": near + rng.exponential(10),
        "f_number_range": (rng.uniform(1, 2), rng.uniform(2, 22)),
    }


def limits_of(free, limits):
    """Those of the limits that are to what is free."""
    return limits if "f_number" in free else {k: v for k, v in limits.items() if k != "f_number_range"}


def by_scipy(points, box, free_aperture, start_radius):
    """The best of many starts of scipy's bounded least squares, on residuals of its own."""
    disparity, target = np.asarray(points.disparity), np.asarray(points.target)
    signed, root = np.asarray(points.signed), np.sqrt(np.asarray(points.weight))

    def blur_of(value):
        radius = value[1] * 1e-2 if free_aperture else start_radius
        return radius, SLOPE * radius * (value[0] - disparity)

    def residual(value):
        _, blur = blur_of(value)
        return root * (np.where(signed, blur, abs(blur)) - target)

    def slopes(value):
        radius, blur = blur_of(value)
        scale = root * np.where(signed, 1.0, np.sign(blur)) * SLOPE
        columns = [scale * radius, scale * 1e-2 * (value[0] - disparity)]
        return np.stack(columns[: len(value)], axis=1)

    (lower, upper), cuts = box, np.sort(disparity)
    starts = [lower[0], *cuts[:-1] + np.diff(cuts) / 2, upper[0]]
    best = None
    for focus, share in itertools.product(starts, (0.3,) if free_aperture else (0,)):
        first = np.clip([focus, lower[1] + share * (upper[1] - lower[1])], lower, upper)
        size = slice(0, 2 if free_aperture else 1)
        first = np.clip(first, lower + 1e-9 * (upper - lower), upper - 1e-9 * (upper - lower))
        found = scipy.optimize.least_squares(
            residual, first[size], slopes, bounds=(lower[size], upper[size]), method="dogbox",
            xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=200,
        )  # fmt: skip
        if best is None or found.cost < best.cost:
            best = found
    return best


@pytest.mark.parametrize("free_aperture", [False, True])
def test_nothing_is_better_by_scipy(make_setup, make_points, free_aperture):
    """A hundred problems, ten within the same bounds at a time."""
    camera, _ = make_setup()
    kinds = set()
    for group in range(10):
        limits = random_limits(np.random.default_rng(group))
        low, high = limits["f_number_range"]
        _, lens = make_setup(f_number=(low * high) ** 0.5)
        problems = [make_points(*random_problem(10 * group + index)[0]) for index in range(10)]
        free = BOTH if free_aperture else BOTH[:1]
        many = solve_many(stacked(problems), camera, lens, free=free, **limits_of(free, limits))
        apart = jax.tree.map(np.asarray, many)
        scale = np.array([1.0, 100.0])
        lower = np.array([1 / limits["max_focus_distance"], 0.025 / high]) * scale
        upper = np.array([1 / limits["min_focus_distance"], 0.025 / low]) * scale
        for index, points in enumerate(problems):
            solution = jax.tree.map(lambda leaf, i=index: leaf[i], apart)
            kinds |= set(solution.active_bounds) or {"inside"}
            best = by_scipy(points, (lower, upper), free_aperture, float(lens.aperture_radius))
            # Observed 7e-16 relative.
            assert float(solution.cost) <= best.cost * (1 + 1e-12)
            if float(solution.cost) > best.cost * (1 - 1e-8):
                # Where costs agree so do solutions; observed 2e-8, which is scipy's.
                np.testing.assert_allclose((parameters(solution) * scale)[: best.x.size], best.x, rtol=1e-6)
            error = np.asarray(solution.error)
            np.testing.assert_allclose(
                float(solution.cost), 0.5 * np.sum(np.asarray(points.weight) * error**2), rtol=1e-12
            )
    expected = {"inside", "min_focus_distance", "max_focus_distance"}
    assert kinds >= (expected | {"min_f_number", "max_f_number"} if free_aperture else expected)


@pytest.mark.parametrize("seed", range(4))
def test_jaxopt_agrees(make_setup, make_points, seed):
    rows, limits = random_problem(seed)
    camera, lens = make_setup(f_number=2.0)
    points = make_points(*rows)
    first = solve(points, camera, lens, free=BOTH, **limits)
    solver = JaxoptLBFGSB(atol=1e-9)
    second = solve(points, camera, lens, free=BOTH, solver=solver, max_steps=500, throw=False, **limits)
    # Observed 3e-16 relative in cost and 4e-15 in the parameters.
    np.testing.assert_allclose(float(second.cost), float(first.cost), rtol=1e-12)
    np.testing.assert_allclose(parameters(second), parameters(first), rtol=1e-8)


class TestInvariance:
    rows = ((0.2, 0, True, 1), (0.5, 12.0, False, 2), (1.0, -7.0, True, 0.5), (0.8, 3.0, False, 1))

    def test_order_does_not_matter(self, make_setup, make_points):
        camera, lens = make_setup()
        expected = parameters(solve(make_points(*self.rows), camera, lens, free=BOTH))
        for order in itertools.islice(itertools.permutations(self.rows), 0, 24, 5):
            found = solve(make_points(*order), camera, lens, free=BOTH)
            np.testing.assert_allclose(parameters(found), expected, rtol=1e-12)

    def test_a_duplicate_counts_as_weight(self, make_setup, make_points):
        camera, lens = make_setup()
        twice = [(*row[:3], 2 * row[3]) if row == self.rows[1] else row for row in self.rows]
        weighted = solve(make_points(*twice), camera, lens, free=BOTH)
        doubled = solve(make_points(*self.rows, self.rows[1]), camera, lens, free=BOTH)
        np.testing.assert_allclose(parameters(doubled), parameters(weighted), rtol=1e-12)

    @pytest.mark.parametrize("scale", [1e-6, 1e6])
    def test_the_scale_of_weights_does_not_matter(self, make_setup, make_points, scale):
        camera, lens = make_setup()
        expected = solve(make_points(*self.rows), camera, lens, free=BOTH)
        scaled = [(*row[:3], scale * row[3]) for row in self.rows]
        found = solve(make_points(*scaled), camera, lens, free=BOTH)
        np.testing.assert_allclose(parameters(found), parameters(expected), rtol=1e-12)
        np.testing.assert_allclose(float(found.cost), scale * float(expected.cost), rtol=1e-10)

    def test_a_weight_of_a_million_wins(self, make_setup, make_points):
        camera, lens = make_setup()
        points = make_points(
            (0.2, 0, True, 1e6), (1.0, 0, True, 1e-6), (0.5, 10, False, 1e-6), (0.9, 0, True, 0)
        )
        solution = solve(points, camera, lens)
        np.testing.assert_allclose(solution.lens.focus_disparity, 0.2, rtol=1e-10)


@pytest.mark.parametrize("free", [BOTH[:1], BOTH])
def test_float32_agrees(make_setup, make_points, free):
    worst = 0.0
    for seed in range(12):
        rows, limits = random_problem(seed)
        f_number = (limits["f_number_range"][0] * limits["f_number_range"][1]) ** 0.5
        camera, lens = make_setup(f_number=f_number)
        limits = limits_of(free, limits)
        exact = solve(make_points(*rows), camera, lens, free=free, **limits)
        with jax.enable_x64(False):
            camera, lens = make_setup(f_number=f_number)
            single = solve(make_points(*rows), camera, lens, free=free, **limits)
            assert single.lens.focus_disparity.dtype == jnp.float32
        assert single.active_bounds == exact.active_bounds
        assert single.undetermined == exact.undetermined
        worst = max(worst, np.max(np.abs(parameters(single) / parameters(exact) - 1)))
    # Observed 2e-7.
    assert worst < 1e-5


def test_float32_survives_weights_of_twelve_decades(make_setup, make_points):
    rows = [(0.2, 0, True, 1e6), (0.9, 15.0, False, 1e-6), (0.21, 3.0, False, 1e6), (0.5, 7.0, True, 1)]
    camera, lens = make_setup()
    exact = solve(make_points(*rows), camera, lens, free=BOTH)
    with jax.enable_x64(False):
        camera, lens = make_setup()
        single = solve(make_points(*rows), camera, lens, free=BOTH)
    np.testing.assert_allclose(parameters(single), parameters(exact), rtol=1e-4)


def test_the_second_call_does_not_compile(make_setup, make_points):
    camera, lens = make_setup()
    solve(make_points((0.4, 0, True, 1), (0.2, 3, False, 1)), camera, lens)
    other = dataclasses.replace(make_points((0.1, 2.0, False, 5), (0.9, 0, True, 1)), names=tuple("abcdef"))
    with compilations() as compiled:
        assert solve(other, camera, lens, min_focus_distance=0.3).points.names == tuple("abcdef")
    assert compiled == []


def test_an_object_is_met_when_its_worst_sample_is(make_setup, make_points):
    camera, lens = make_setup()
    points = dataclasses.replace(
        make_points(*[(disparity, 0, True, 1) for disparity in (0.4, 0.42, 0.48, 0.4, 0.4, 0.42)]),
        wish=jnp.zeros(6, dtype=int),
        names=("face",),
    )
    (line,) = solve(points, camera, lens).table()
    assert line.samples == 6
    assert line.weight == 6.0
    assert line.distance == 1 / 0.48
    np.testing.assert_allclose(line.residual, SLOPE * 0.0125 * (2.52 / 6 - 0.48), rtol=1e-12)
    assert not line.met


def test_solutions_are_vmapped(make_setup):
    camera, lens = make_setup()
    count = 5
    disparity = jnp.linspace(0.1, 0.9, count)

    def one(disparity):
        points = ImagePoints(
            xy=jnp.zeros((1, 2)), disparity=disparity[None], target=jnp.zeros(1), signed=jnp.array([True]),
            weight=jnp.ones(1), tolerance=jnp.ones(1), wish=jnp.array([0]), names=("one",),
        )  # fmt: skip
        return solve(points, camera, lens).lens.focus_disparity

    np.testing.assert_allclose(jax.vmap(one)(disparity), disparity, rtol=1e-12)
