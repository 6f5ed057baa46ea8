"""The diagnosis says what holds the solution, what does not, and what each wish costs the others."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import (
    AtLeast,
    AtPoint,
    Blur,
    Conflict,
    FocusPoint,
    SameBlur,
    Sharp,
    ShownAt,
    diagnose,
    locate,
    solve,
    solve_many,
    stacked,
)
from focusjax.focus._findings import conflict_sentences
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens

PLANE = ("focus", "tilt", "swing")
BOTH = ("focus", "f_number")
# Blur per dioptre at f/4: 2 f E = 2 * 50 / 36 * 640 px * 50 mm / 8.
PER_DIOPTRE = 2 * 0.05 / 0.036 * 640 * 0.00625


@pytest.fixture
def camera():
    return make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)


@pytest.fixture
def lens():
    return thin_lens(focus_distance=2.0, f_number=4.0, focal_length=0.05)


def at(x, y, z, wish=None, **more):
    return FocusPoint(AtPoint((x, y, -z)), Sharp() if wish is None else wish, **more)


def test_two_sharp_points_pull_against_each_other(camera, lens):
    solution = solve(locate([at(0, 0, 2, name="near"), at(0, 0, 4, name="far")], camera), camera, lens)
    (conflict,) = diagnose(solution).conflicts
    half = PER_DIOPTRE * 0.125
    assert (conflict.first, conflict.second) == ("near", "far")
    np.testing.assert_allclose([conflict.first_gains, conflict.second_gains], half, rtol=1e-9)
    assert diagnose(solution).sentences[:2] == (
        f'Not all wishes can be met: the best is {half:.3g} px off at "near".',
        '"near" and "far" pull against each other: without "far", "near" would be met 1.4 px better;'
        ' without "near", "far" 1.4 px.',
    )


def test_standard_errors_are_those_of_linear_regression(camera, lens):
    wishes = [at(0, 0, z, Blur(b, signed=True), tolerance=0.5) for z, b in ((1, -9), (2, 1), (4, 12), (3, 4))]
    solution = solve(locate(wishes, camera), camera, lens, free=BOTH)
    found = diagnose(solution).standard_errors
    disparity = 1 / np.array([1, 2, 4, 3])
    radius, focus = float(solution.lens.aperture_radius), float(solution.lens.focus_disparity)
    slope = PER_DIOPTRE / 0.00625
    jacobian = np.stack([np.full(4, slope * radius), slope * (focus - disparity)], axis=-1)
    focus_error, radius_error = 0.5 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    np.testing.assert_allclose(found["focus"], focus_error, rtol=1e-6)
    np.testing.assert_allclose(found["f_number"], 0.05 / (2 * radius**2) * radius_error, rtol=1e-6)


def test_points_on_a_line_leave_a_tilt_undetermined(camera, lens):
    points = locate([at(x * z, 0, z) for x, z in ((-0.2, 2), (0, 3), (0.2, 6))], camera)
    solution = solve(points, camera, lens, free=PLANE)
    assert solution.undetermined == ("tilt",)
    found = diagnose(solution)
    (direction,) = found.open_directions
    np.testing.assert_allclose([abs(direction[name]) for name in PLANE], [0, 1, 0], atol=1e-9)
    assert found.singular_values[-1] < 1e-9
    assert found.standard_errors["tilt"] == np.inf
    assert (
        "The points lie on one line in the picture, 0 degrees from level: the tilt that turns the plane in"
        " focus about it is undetermined."
    ) in found.sentences


def test_one_distance_leaves_the_f_number_undetermined(camera, lens):
    found = diagnose(solve(locate([at(0, 0, 2)], camera), camera, lens, free=BOTH))
    assert found.standard_errors["f_number"] == np.inf
    assert found.sentences == (
        "All wishes are at one distance, so that any f-number will do; it stays as it was.",
    )


def test_a_wish_out_of_reach_is_named(camera, lens):
    wishes = [at(0, 0, 1, name="face"), at(0, 0, 1.2, AtLeast(300.0), name="sign")]
    solution = solve(locate(wishes, camera), camera, lens, free=BOTH, min_focus_distance=0.8)
    found = diagnose(solution)
    (out,) = found.unreachable
    # Wide open and focused on infinity, blur at 1.2 m is this many pixels short.
    best = 300 - PER_DIOPTRE * 4 / 1.2
    assert out.name == "sign"
    np.testing.assert_allclose(out.best, best, rtol=1e-9)
    assert f'"sign" is out of reach even alone: the best is {best:.3g} px off.' in found.sentences
    assert found.active_bounds == ("max_focus_distance", "min_f_number")
    assert any(line.startswith("The focus is at infinity, as far as it goes") for line in found.sentences)
    assert any(line.startswith("The widest aperture stands in the way") for line in found.sentences)
    assert found.standard_errors["f_number"] == 0.0


def test_nothing_is_said_of_what_is_well(camera, lens):
    wishes = [at(0, 0, 2), at(0, 0, 4, Blur(5.0))]
    assert diagnose(solve(locate(wishes, camera), camera, lens, free=BOTH)).sentences == ()


def test_one_of_many_is_diagnosed_as_by_itself(camera, lens):
    sets = [locate([at(0, 0, 2, name="near"), at(0, 0, z, name="far")], camera) for z in (2.0, 4.0)]
    many = solve_many(stacked(sets), camera, lens)
    with pytest.raises(ValueError, match=r"is of 2 problems; diagnose one of them, such as `solution"):
        diagnose(many)
    alone, one = diagnose(solve(sets[1], camera, lens)), diagnose(many.at(1))
    assert one.sentences == alone.sentences
    assert [(c.first, c.second) for c in one.conflicts] == [("near", "far")]
    # Observed: the same to the last digit.
    assert one.conflicts[0].first_gains == pytest.approx(alone.conflicts[0].first_gains, abs=1e-9)


def test_a_pull_of_one_side_alone_is_reported_with_its_direction(camera, lens):
    wishes = [at(0, 0, 2, weight=100.0, name="hero"), at(0, 0, 4, name="extra")]
    (conflict,) = diagnose(solved := solve(locate(wishes, camera), camera, lens)).conflicts
    whole = PER_DIOPTRE * 0.25
    np.testing.assert_allclose(
        [conflict.first_gains, conflict.second_gains], [whole / 101, whole * 100 / 101], rtol=1e-9
    )
    assert not conflict.mutual
    assert (
        f'"hero" costs "extra" {whole * 100 / 101:.2g} px: without "hero", "extra" would be met that much'
        ' better; without "extra", "hero" would gain nothing.'
    ) in diagnose(solved).sentences


def test_only_the_worst_conflicts_are_put_into_words():
    lines = conflict_sentences([Conflict("a", f"b{index}", 9.0 - index, 1.0) for index in range(8)])
    assert len(lines) == 7
    assert lines[0].startswith('"a" and "b0" pull against each other: without "b0", "a" would be met 9 px')
    assert lines[-1] == "2 more pairs pull against each other, by less."


def test_points_whose_blur_is_to_be_had_are_at_a_distance_too(camera, lens):
    wishes = [at(0, 0, 2, name="near", weight=0.0), at(0.1, 0, 4, SameBlur("near"), name="far")]
    solution = solve(locate(wishes, camera), camera, lens, free=BOTH)
    assert [row.partner for row in solution.table()] == ["", "near"]
    found = diagnose(solution)
    # Half-way in disparity both are blurred alike, through any opening.
    assert found.sentences == (
        "The wishes leave the f-number open; it stays as near as it can to where it was.",
    )


def test_the_line_that_leaves_a_tilt_open_is_that_of_all_points(camera, lens):
    low = at(-0.4, 0.4, 4, name="low", weight=0.0)
    wishes = [at(0.2, 0, 2), low, at(0.4, -0.4, 4, SameBlur("low", same_side=True), name="alike")]
    found = diagnose(solve(locate(wishes, camera), camera, lens, free=PLANE))
    assert len(found.open_directions) == 1
    # Two wishes always lie on a line, but turning about that would blur the third place.
    assert found.sentences == (
        "The wishes leave the focus, the tilt and the swing open; they stay as near as they can to where they"
        " were.",
    )


def test_what_would_move_the_frame_is_named(camera, lens):
    wishes = [at(0, 0, 2), at(0.3, 0, 4, ShownAt(320.0, 100.0), name="top")]
    found = diagnose(solve(locate(wishes, camera), camera, lens))
    assert (
        '"top" is not where it is wished, and nothing that is free can move it there: add "shift" and "rise"'
        " to what is free, or move the camera."
    ) in found.sentences


def test_one_of_many_is_taken_out_by_at(camera, lens):
    points = [locate([at(0, 0, z, name="face")], camera) for z in (1.0, 2.0)]
    many = solve_many(stacked(points), camera, lens, free="focus")
    one = many.at(1)
    assert one.table()[0].met
    assert one.active_bounds == one.undetermined == ()
    assert float(one.lens.focus_distance()) == pytest.approx(2.0)
    for ask in (many.table, lambda: many.active_bounds, lambda: many.undetermined):
        with pytest.raises(ValueError, match=r"the solution is of 2 problems; `solution\.at\(0\)\."):
            ask()
    with pytest.raises(ValueError, match="there are 2 solutions, and no number 2"):
        many.at(2)
    with pytest.raises(ValueError, match="the solution is of one problem"):
        one.at(0)
