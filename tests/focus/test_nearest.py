"""Of all equally good solutions the one is found that changes the picture least."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import AT_LEAST, AT_MOST, EQUAL, Result, solve, solve_frames

BOTH = ("focus", "f_number")
# Blur per metre of aperture radius and dioptre for the fixture's camera: 2 f = 2 * 50 / 36 * 640 px.
SLOPE = 2 * 0.05 / 0.036 * 640
NO_SAY = ((0.5, 0.0, True, 0.0), (0.5, 0.0, False, 0.0))
"""Points of either sign without weight: with them one program serves wishes of both."""


def parameters(solution):
    return np.array([solution.lens.focus_disparity, solution.lens.aperture_radius])


class TestWhatWishesLeaveOpen:
    def test_one_plane_leaves_the_f_number_alone(self, make_setup, make_points):
        camera, lens = make_setup()
        solution = solve(make_points((0.5, 0, True, 1)), camera, lens, free=BOTH)
        assert solution.undetermined == ("f_number",)
        assert solution.result == Result.undetermined
        np.testing.assert_allclose(parameters(solution), [0.5, float(lens.aperture_radius)], rtol=1e-15)

    @pytest.mark.parametrize("relation", [EQUAL, AT_LEAST])
    @pytest.mark.parametrize(
        ("focus", "f_number", "target", "signed", "nearest", "others"),
        [
            (1.0, 2.0, 20.0, False, 0.2, NO_SAY),
            (5.0, 2.0, 10.0, False, 0.2, NO_SAY),
            (np.inf, 4.0, 30.0, False, 0.2, NO_SAY),
            (5.0, 2.0, 16.0, True, 1.0, NO_SAY),
            (3.0, 16.0, 20.0, True, 0.9, ()),
        ],
    )
    def test_the_picture_changes_least(
        self, make_setup, make_points, focus, f_number, target, signed, nearest, others, relation
    ):
        """Of all settings that give one blur the nearest to the start, stills and shots, by brute force."""
        camera, lens = make_setup(focus_distance=focus, f_number=f_number)
        points = make_points((0.5, target, signed, 1), *others)
        points = dataclasses.replace(points, relation=jnp.full(points.wish.shape, relation))
        options = {"free": BOTH, "min_focus_distance": nearest}
        start = np.array([1 / focus, 0.025 / f_number])
        scale = np.array([SLOPE * start[1], 10.0 / start[1]])

        def far(value):
            return np.linalg.norm(scale * (value - start), axis=-1)

        # What gives the blur on either side of the focus; of limits that are missed at the start, their ends.
        radius = 0.025 / np.geomspace(1, 32, 200_001)
        sides = (1.0,) if signed else (1.0, -1.0)
        every = np.concatenate(
            [np.stack([0.5 + side * target / (SLOPE * radius), radius], -1) for side in sides]
        )
        every = every[(every[:, 0] >= 0) & (every[:, 0] <= 1 / nearest)]
        best = far(every).min()
        found = solve(points, camera, lens, **options)
        shot = solve_frames([points], camera, lens, **options)
        assert float(found.cost) < 1e-18
        # Observed: 4e-5 px more.
        assert far(parameters(found)) == pytest.approx(best, abs=1e-3)
        # Observed: 5e-6.
        np.testing.assert_allclose(
            [shot.lens.focus_disparity[0], shot.lens.aperture_radius[0]], parameters(found), rtol=1e-5
        )

    def test_a_pinhole_keeps_its_focus(self, make_setup, make_points):
        camera, lens = make_setup()
        pinhole = dataclasses.replace(lens, aperture_radius=jnp.zeros(()))
        solution = solve(make_points((0.5, 0, True, 1)), camera, pinhole)
        assert solution.undetermined == ("focus",)
        assert float(solution.lens.focus_disparity) == 0.2
        assert float(solution.error[0]) == 0.0

    @pytest.mark.parametrize(("focus", "nearer"), [(5.0, False), (1.0, True), (2.0, True)])
    def test_of_two_equal_valleys_the_one_that_changes_the_picture_less(
        self, make_setup, make_points, focus, nearer
    ):
        """And of two that change it as much, the one of nearer focus."""
        camera, lens = make_setup(focus_distance=focus)
        solution = solve(make_points((0.5, 5.0, False, 1)), camera, lens)
        assert (float(solution.lens.focus_disparity) > 0.5) == nearer
        np.testing.assert_allclose(abs(float(solution.blur[0])), 5.0, rtol=1e-12)

    def test_a_valley_behind_infinity_is_not_taken(self, make_setup, make_points):
        camera, lens = make_setup()
        solution = solve(make_points((0.0, 5.0, False, 1)), camera, lens, min_focus_distance=1.0)
        assert float(solution.lens.focus_disparity) > 0
        np.testing.assert_allclose(solution.error, 0, atol=1e-10)


class TestSeveralLimits:
    """Limits at several distances: only a part of those that the start misses hold the solution."""

    @pytest.mark.parametrize(
        ("focus", "f_number", "most", "distances"),
        [
            (1.0, 2.0, 5.0, (2.0, 4.0)),
            (1.0, 4.0, 5.0, (2.0, 2.2, 4.0)),
            (0.5, 2.0, 5.0, (2.0, 2.2, 4.0)),
            (np.inf, 2.0, 5.0, (2.0, 2.2, 4.0)),
            (1.0, 2.0, 2.0, (1.0, 2.0, 8.0)),
            (2.0, 2.0, 5.0, (1.5, 4.0, 9.0, 20.0)),
            (3.0, 2.0, 5.0, (3.0, 3.0, 3.0)),
        ],
    )
    def test_the_picture_changes_least(self, make_setup, make_points, focus, f_number, most, distances):
        camera, lens = make_setup(focus_distance=focus, f_number=f_number)
        points = make_points(*((1 / distance, most, False, 1) for distance in distances), *NO_SAY)
        points = dataclasses.replace(points, relation=jnp.full(points.wish.shape, AT_MOST))
        options = {"free": BOTH, "min_focus_distance": 0.2}
        found = solve(points, camera, lens, **options)
        shot = solve_frames([points], camera, lens, **options)

        start = np.array([1 / focus, 0.025 / f_number])
        scale = np.array([SLOPE * start[1], 10.0 / start[1]])
        radius = 0.025 / np.geomspace(1, 32, 200_001)
        # For each radius the foci that keep all limits are an interval.
        reach = most / (SLOPE * radius)
        low = np.maximum(max(1 / distance for distance in distances) - reach, 0.0)
        high = np.minimum(min(1 / distance for distance in distances) + reach, 5.0)
        focused = np.clip(start[0], low, high)
        change = np.hypot(scale[0] * (focused - start[0]), scale[1] * (radius - start[1]))
        best = change[low <= high].min()
        got = np.linalg.norm(scale * (parameters(found) - start))
        assert float(found.cost) < 1e-18
        # Observed: 6e-5 px.
        assert got == pytest.approx(best, abs=1e-3)
        np.testing.assert_allclose(
            [shot.lens.focus_disparity[0], shot.lens.aperture_radius[0]], parameters(found), rtol=1e-5
        )

    def test_a_tilted_lens_turns_no_more_than_it_must(self, make_setup, make_points):
        """With tilt free, too, no of many random lenses that keep the limits changes the picture less."""
        camera, lens = make_setup(focus_distance=1.0, f_number=2.0)
        at = [(320.0, 40.0), (320.0, 240.0), (320.0, 440.0)]
        points = make_points(*((disparity, 4.0, False, 1) for disparity in (0.2, 0.4, 0.8)), size=3)
        points = dataclasses.replace(points, xy=jnp.array(at), relation=jnp.full(points.wish.shape, AT_MOST))
        found = solve(points, camera, lens, free=("focus", "f_number", "tilt"))
        assert float(found.cost) < 1e-18

        height = (240.0 - np.array(at)[:, 1]) / float(camera.focal_px)

        def blur(focus, radius, plane):
            return SLOPE * radius * (focus + plane * height[:, None] - np.array([[0.2], [0.4], [0.8]]))

        start, scale = (1.0, 0.0125), (SLOPE * 0.0125, 10.0 / 0.0125, 0.0125 * 480)
        own = (float(found.lens.plane[2]), float(found.lens.aperture_radius))
        turn = float(found.lens.plane[1])
        np.testing.assert_allclose(
            np.abs(blur(*(np.array([value]) for value in (*own, turn)))[:, 0]), np.abs(found.blur), rtol=1e-6
        )

        def change(focus, radius, plane):
            return np.sqrt(
                (scale[0] * (focus - start[0])) ** 2
                + (scale[1] * (radius - start[1])) ** 2
                + (scale[2] * plane) ** 2
            )

        best = change(*own, turn)
        rng = np.random.default_rng(0)
        for width in (1.0, 0.1, 0.01):
            count = 200_000
            focus = own[0] + width * rng.normal(size=count)
            radius = np.clip(own[1] * np.exp(width * rng.normal(size=count)), 0.05 / 64, 0.025)
            plane = turn + 10.0 * width * rng.normal(size=count)
            kept = (np.abs(blur(focus, radius, plane)) <= 4.0).all(axis=0)
            kept &= (focus >= 0.0) & (focus <= 10.0) & (np.abs(plane) <= np.sin(np.pi / 4) / 0.05)
            assert kept.any()
            assert change(focus, radius, plane)[kept].min() >= best * (1 - 1e-6)
