"""All frames of a shot solved together: closed forms, SciPy on the same residuals, one frame, steadiness."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from focusjax.focus import AT_MOST, Prior, Result, diagnose, solve, solve_frames, stacked
from focusjax.lens import thin_lens

FRAMES = 45
"""Three fewer than there is room for, so that every test has frames that fill the shot up."""

GAIN = 2.0 * 0.05 / 0.036 * 640
RADIUS = 0.0125


def differences(count, order):
    return np.diff(np.eye(count), n=order, axis=0)


def solve_focus(points, camera, lens, **options):
    """As with the focus free alone: the f-number has no room (and programs compiled with it free serve)."""
    number = float(lens.f_number(camera))
    room = (number, number * (1 + 1e-9))
    return solve_frames(points, camera, lens, free=("focus", "f_number"), f_number_range=room, **options)


def test_sharp_wishes_give_the_smoothing_spline(make_setup, make_frames):
    """With the focus free and signed wishes the problem is linear: the normal equations by hand."""
    camera, lens = make_setup()
    rng = np.random.default_rng(1)
    disparity = rng.uniform(0.2, 1.0, (FRAMES, 1))
    weight = rng.uniform(0.0, 2.0, (FRAMES, 1))
    weight[4:7] = 0.0
    solution = solve_focus(
        make_frames(disparity, weight=weight), camera, lens, smoothness=30.0, steadiness=0.5
    )
    bend, pace = differences(FRAMES, 2), differences(FRAMES, 1)
    normal = np.diag(weight[:, 0]) + 30.0 * bend.T @ bend + 0.5 * pace.T @ pace
    expected = np.linalg.solve(normal, weight[:, 0] * disparity[:, 0])
    # The f-number's room is 1e-9 of it. Observed: 3e-12, and 2e-9 px.
    assert np.abs(solution.settings()["focus_per_m"] - expected).max() < 1e-9
    blur = GAIN * RADIUS * (expected[:, None] - disparity)
    assert np.abs(np.asarray(solution.blur)[:, :1] - blur).max() < 1e-7
    assert solution.settings()["f_number"].tolist() == pytest.approx([2.0] * FRAMES, rel=1e-8)


def test_one_frame_is_solved_as_a_picture_is(make_setup, make_frames):
    """With limits, expectations, and wishes without a side."""
    camera, lens = make_setup()
    rng = np.random.default_rng(2)
    worst = 0.0
    for trial in range(12):
        signed = rng.random(4) < 0.5
        target = np.where(signed, rng.normal(0, 8, 4), rng.uniform(0, 20, 4))
        disparity, weight = rng.uniform(0, 2, (1, 4)), rng.uniform(0.1, 3, (1, 4))
        (points,) = make_frames(disparity, target, signed, weight, relation=trial % 3)
        options = {
            "free": ("focus", "f_number"),
            "min_focus_distance": 0.6,
            "priors": {"f_number": Prior(2.8, 1.5)},
        }
        one = solve(points, camera, lens, **options)
        together = solve_frames([points], camera, lens, **options)
        # Observed: 3e-15.
        assert float(together.cost) == pytest.approx(float(one.cost), rel=1e-9)
        worst = max(worst, abs(float(together.at(0)[1].focus_disparity - one.lens.focus_disparity)))
    # Observed: 1e-9 dioptres.
    assert worst < 1e-6


def stacked_residuals(points, *, smoothness, steadiness):
    """The same residuals by numpy, as a function of all frames' focus and aperture in pixels, and bounds."""
    all_ = stacked(points)
    disparity, target, signed, weight = (
        np.asarray(each) for each in (all_.disparity, all_.target, all_.signed, all_.weight)
    )
    scale = np.array([GAIN * RADIUS, 10.0 / RADIUS])

    def residuals(flat):
        pixels = flat.reshape(-1, 2)
        focus, radius = np.split(pixels / scale, 2, axis=1)
        blur = GAIN * radius * (focus - disparity)
        error = np.where(signed, blur, np.abs(blur)) - target
        return np.concatenate(
            [
                (np.sqrt(weight) * error).ravel(),
                np.sqrt(smoothness) * np.diff(pixels, n=2, axis=0).ravel(),
                np.sqrt(steadiness) * np.diff(pixels, axis=0).ravel(),
            ]
        )

    lower, upper = scale * [0.0, 0.05 / 32.0], scale * [1 / 0.6, 0.05 / 2.8]
    return residuals, np.tile(lower, len(points)), np.tile(upper, len(points))


def test_scipy_finds_the_same_optimum(make_setup, make_frames):
    """Wishes that drift and come and go, with and without a side, some bounds active."""
    camera, lens = make_setup()
    rng = np.random.default_rng(3)
    worst, at_bounds = 0.0, 0
    for smoothness in (3.0, 30.0, 300.0):
        drift = np.cumsum(rng.normal(0, 0.03, (FRAMES, 4)), axis=0)
        disparity = np.abs(drift + rng.uniform(0.2, 1.6, 4))
        signed = rng.random(4) < 0.5
        target = np.where(signed, rng.normal(0, 8, 4), rng.uniform(0, 20, 4))
        weight = rng.uniform(0, 1, (FRAMES, 4)) * (rng.random((FRAMES, 4)) < 0.7)
        points = make_frames(disparity, target, signed, weight)
        options = {"smoothness": smoothness, "steadiness": 1.0}
        solution = solve_frames(
            points, camera, lens,
            free=("focus", "f_number"), min_focus_distance=0.6, f_number_range=(1.4, 16.0), **options,
        )  # fmt: skip
        residuals, lower, upper = stacked_residuals(points, **options)
        ours = np.asarray(solution.pixels).ravel()
        assert 0.5 * np.sum(residuals(ours) ** 2) == pytest.approx(float(solution.cost), rel=1e-12)
        start = np.clip(ours + rng.normal(0, 0.3, ours.size), lower + 1e-9, upper - 1e-9)
        found = scipy.optimize.least_squares(
            residuals, start, bounds=(lower, upper), xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=400
        )
        worst = max(worst, float(solution.cost) / found.cost - 1.0)
        at_bounds += int(jnp.sum(solution.at_lower | solution.at_upper))
    # Observed: 4e-16.
    assert worst < 1e-9
    assert at_bounds > 0


def least_cost(disparity, target, weight, smoothness, steadiness):
    """The least cost over all sides that the wishes of all frames can be on, each solved by itself."""
    count, wishes = disparity.shape
    place = np.argsort(np.argsort(disparity, axis=1), axis=1)
    # The first `cut` of a frame's wishes in depth are before the focus.
    cuts = np.array(list(itertools.product(range(wishes + 1), repeat=count)))
    side = np.where(place[None] < cuts[..., None], 1.0, -1.0)
    wanted = GAIN * RADIUS * disparity + side * target
    bend, pace = differences(count, 2), differences(count, 1)
    normal = np.diag(weight.sum(axis=1)) + smoothness * bend.T @ bend + steadiness * pace.T @ pace
    right = np.sum(weight * wanted, axis=2)
    pixels = np.linalg.solve(normal, right.T).T
    return 0.5 * np.min(np.sum(weight * wanted**2, axis=(1, 2)) - np.sum(right * pixels, axis=1))


def test_the_best_sides_are_found(make_setup, make_frames):
    """Wishes that contradict each other and leave their sides open, against all 4096 choices of sides."""
    camera, lens = make_setup()
    for seed in (10, 14, 19, 21, 32, 39, 45, 174):
        rng = np.random.default_rng(seed)
        disparity = 1.0 + rng.uniform(0, 1, 3) + np.cumsum(rng.normal(0, 0.1, (6, 3)), axis=0)
        target, weight = rng.uniform(2, 12, 3), rng.uniform(0.2, 2, (6, 3))
        smoothness, steadiness = [(1.0, 0.1), (30.0, 1.0), (300.0, 10.0)][seed % 3]
        solution = solve_focus(
            make_frames(disparity, target, False, weight), camera, lens,
            smoothness=smoothness, steadiness=steadiness, min_focus_distance=0.2,
        )  # fmt: skip
        best = least_cost(disparity, target, weight, smoothness, steadiness)
        # The f-number has room of 1e-9. Observed: from -9e-9 to 1e-12; these seeds were chosen from 240, all
        # of which come as near, because walks from each frame's own answers miss the best by 0.4 to 93 %.
        assert float(solution.cost) == pytest.approx(best, rel=1e-7)


def test_large_errors_do_not_make_it_creep(make_setup, make_frames):
    """Wishes that contradict each other, with f-number: steps of Gauss and Newton alone take hundreds."""
    camera, lens = make_setup()
    rng = np.random.default_rng(5)
    signed = [True, True, False]
    target = np.where(signed, rng.normal(0, 6, (5, 3)), rng.uniform(2, 12, (5, 3)))
    points = make_frames(rng.uniform(0.2, 1.2, (5, 3)), target, signed, rng.uniform(0.2, 2, (5, 3)))
    solution = solve_frames(
        points, camera, lens, free=("focus", "f_number"), min_focus_distance=0.35,
        f_number_range=(2.0, 16.0), smoothness=20.0, steadiness=1.0,
    )  # fmt: skip
    assert solution.result == Result.solved
    assert int(solution.steps) <= 100


def test_a_rack_focus_is_smooth_and_arrives(make_setup, make_frames):
    """48 frames from 1 m to 3 m: both ends sharp, no way back, second differences bounded by the gap."""
    camera, lens = make_setup()
    frame = np.arange(48)
    weight = np.stack([np.clip((20 - frame) / 6, 0, 1), np.clip((frame - 27) / 6, 0, 1)], axis=1)
    solution = solve_focus(make_frames(np.tile([1.0, 1 / 3], (48, 1)), weight=weight), camera, lens)
    focus = solution.settings()["focus_per_m"]
    assert abs(focus[0] - 1.0) < 2e-3
    assert abs(focus[-1] - 1 / 3) < 2e-3
    # Between the points where it overshoots, by 0.2 px, it goes one way only.
    assert np.diff(focus[np.argmax(focus) : np.argmin(focus) + 1]).max() < 0
    assert np.ptp(focus) * GAIN * RADIUS < 2 / 3 * GAIN * RADIUS + 0.6
    change = solution.largest_changes()["focus_per_m"]
    # The wishes let go for 13 frames. Observed: 0.043 per frame, 0.0047 per frame^2 (0.10 px per frame^2).
    assert change.per_frame < 0.06
    assert change.per_frame2 < 0.006
    assert change.pixels_per_frame2 == pytest.approx(change.per_frame2 * GAIN * RADIUS)
    # Frame by frame, and then held, it would jump by all of 0.67 dioptres.
    assert solution.largest_changes()["f_number"].per_frame < 1e-8


def test_frames_without_wishes_are_filled_and_the_ends_come_to_rest(make_setup, make_frames):
    camera, lens = make_setup()
    frame = np.arange(FRAMES)
    weight = ((frame == 5) | (frame == 20) | (frame == 21)).astype(float)[:, None]
    disparity = np.where(frame < 10, 0.3, 0.8)[:, None]
    solution = solve_focus(make_frames(disparity, weight=weight), camera, lens, smoothness=4.0)
    focus = solution.settings()["focus_per_m"]
    assert np.all(np.diff(focus[5:21]) > 0)
    # sqrt(4 / 1) = 2 frames: 20 frames later nothing moves. Observed: 1e-7 dioptres per frame.
    assert np.abs(np.diff(focus)[41:]).max() < 1e-5
    assert abs(focus[-1] - 0.8) < 0.15


def test_frames_agree_on_a_side(make_setup, make_frames):
    """A blur that either side would give: alone, frames follow the small wish that wavers."""
    camera, lens = make_setup()
    waver = np.where(np.arange(FRAMES) % 2, 0.02, -0.02)
    disparity = np.stack([np.full(FRAMES, 1.0), 1.0 + waver], axis=1)
    points = make_frames(disparity, [12.0, 0.0], [False, True], [1.0, 0.01])
    alone = np.array([float(solve(each, camera, lens).lens.focus_disparity) for each in points])
    assert np.abs(np.diff(alone)).min() > 0.5
    together = solve_focus(points, camera, lens).settings()["focus_per_m"]
    # Observed: 5e-5.
    assert np.abs(np.diff(together)).max() < 1e-3


def test_limits_hold_in_every_frame(make_setup, make_frames):
    camera, lens = make_setup()
    disparity = np.linspace(0.2, 1.0, FRAMES)[:, None]
    at_most = make_frames(disparity, target=4.0, relation=AT_MOST, signed=False)
    solution = solve_focus(at_most, camera, lens, smoothness=1.0, steadiness=0.0)
    # Within the limit a straight pull is free. Observed: 4.0000.
    assert float(jnp.abs(solution.blur[:, 0]).max()) < 4.0 + 1e-6
    assert float(solution.cost) < 1e-9
    met = solve_focus(
        make_frames(disparity), camera, lens, smoothness=0.0, steadiness=0.0, max_focus_distance=1.5
    )
    focus = met.settings()["focus_per_m"]
    assert np.abs(focus - np.maximum(disparity[:, 0], 1 / 1.5)).max() < 1e-9
    assert np.array_equal(np.asarray(met.at_lower)[:, 0], disparity[:, 0] < 1 / 1.5)


def test_what_no_frame_determines_stays_and_is_named(make_setup, make_frames):
    camera, lens = make_setup()
    points = make_frames(np.full((FRAMES, 1), 0.5))
    solution = solve_frames(points, camera, lens, free=("focus", "f_number"))
    assert solution.undetermined == ("f_number",)
    assert np.abs(solution.settings()["f_number"] - 2.0).max() < 1e-12
    assert solution.result == Result.undetermined


def test_a_zoom_keeps_its_f_number(make_setup, make_frames):
    """The camera's focal length is keyframed: undetermined apertures follow it."""
    camera, _ = make_setup()
    lengths = np.linspace(0.035, 0.085, FRAMES)
    cameras = [
        dataclasses.replace(camera, focal_length=jnp.asarray(length, dtype=float)) for length in lengths
    ]
    lenses = [thin_lens(focus_distance=3, f_number=2.8, focal_length=length) for length in lengths]
    points = make_frames(np.full((FRAMES, 1), 0.5))
    solution = solve_frames(points, cameras, lenses, free=("focus", "f_number"))
    # Observed: 6e-9.
    assert np.abs(solution.settings()["f_number"] - 2.8).max() < 1e-7
    assert np.abs(solution.settings()["focal_length_mm"] - 1000 * lengths).max() < 1e-9


@pytest.mark.slow
def test_a_long_gap_is_bridged_in_single_precision(make_setup, make_frames):
    """Wishes at the two ends only, a stiff bridge between them: the same answer in float32."""
    found = {}
    frame = np.arange(FRAMES)
    for wide in (True, False):
        with jax.enable_x64(wide):
            camera, lens = make_setup()
            weight = np.isin(frame, (0, 1, FRAMES - 2, FRAMES - 1))[:, None]
            points = make_frames(np.where(frame < 9, 0.2, 0.8)[:, None], weight=weight)
            # Room for the f-number that float32 distinguishes from none.
            room = (2.0, 2.0 * (1 + 1e-6))
            found[wide] = solve_frames(
                points, camera, lens, free=("focus", "f_number"), f_number_range=room, smoothness=1e4
            ).settings()["focus_per_m"]
    # Observed: 2e-6. The normal equations' condition is 1e9.
    assert np.abs(found[True] - found[False]).max() < 1e-4
    assert np.all(np.diff(found[True]) > 0)


def test_weights_of_any_size(make_setup, make_frames):
    """Only ratios of weights to smoothness count, over twelve orders of magnitude."""
    camera, lens = make_setup()
    disparity = np.linspace(0.3, 0.9, FRAMES)[:, None] ** 2
    found = [
        solve_focus(
            make_frames(disparity, weight=factor), camera, lens, smoothness=10 * factor, steadiness=factor
        ).settings()["focus_per_m"]
        for factor in (1e-6, 1.0, 1e6)
    ]
    assert np.abs(found[0] - found[1]).max() < 1e-9
    assert np.abs(found[2] - found[1]).max() < 1e-9


def test_too_few_steps_are_reported(make_setup, make_frames):
    camera, lens = make_setup()
    points = make_frames(np.linspace(0.3, 0.9, FRAMES)[:, None], target=5.0, signed=False)
    with pytest.raises(RuntimeError, match="the solve of 45 frames failed after 1 steps"):
        solve_frames(points, camera, lens, free=("focus", "f_number"), max_steps=1)
    solution = solve_frames(points, camera, lens, free=("focus", "f_number"), max_steps=1, throw=False)
    assert solution.result == Result.max_steps_reached


def test_diagnosis_says_when_what_is_missed_and_why(make_setup, make_frames):
    """Two wishes that agree until frame 24 and then part; the nearer one goes within the closest focus."""
    camera, lens = make_setup()
    disparity = np.full((FRAMES, 2), 0.5)
    disparity[24:, 1] = 0.8
    frames = make_frames(disparity)
    found = diagnose(solve_focus(frames, camera, lens, smoothness=1.0, steadiness=0.0))
    assert [each.name for each in found.missed] == ["wish 0", "wish 1"]
    for missed in found.missed:
        ((first, last),) = missed.frames
        assert abs(first - 25) <= 2
        assert last == FRAMES
        # Half of the difference, and more where they part.
        assert 0.149 * GAIN * RADIUS < missed.worst < 0.25 * GAIN * RADIUS
    (conflict,) = found.conflicts
    # Each would be met in full without the other. Observed: within 2 %.
    assert conflict.mutual
    assert conflict.first_gains == pytest.approx(found.missed[0].worst, rel=0.1)
    assert conflict.frames[0][1] == FRAMES
    # The f-number has next to no room.
    assert set(found.active_bounds) <= {"max_f_number", "min_f_number"}
    # Alone, too, the second cannot jump as fast as its place does.
    (jump,) = found.unreachable
    assert (jump.name, jump.frames) == ("wish 1", ((25, 25),))
    assert found.sentences[0].startswith('"wish 0" is missed in frames 2')
    counts = np.zeros((FRAMES, len(frames[0].names)), dtype=bool)
    assert diagnose(solve_focus(frames, camera, lens), counts=counts).missed == ()
    near = np.linspace(0.5, 1.0, FRAMES)[:, None]
    held = diagnose(
        solve_focus(make_frames(near), camera, lens, smoothness=1.0, steadiness=0.0, min_focus_distance=1.25)
    )
    # From 0.8 dioptres on: frame 28 of 45.
    ((first, last),) = held.active_bounds["min_focus_distance"]
    assert (abs(first - 28) <= 2, last) == (True, FRAMES)
    (out,) = held.unreachable
    assert out.best == pytest.approx(0.2 * GAIN * RADIUS, rel=0.02)
    assert any(
        line.startswith("The closest focus distance stands in the way in frames") for line in held.sentences
    )


def test_frames_that_are_held_keep_their_lens_and_others_follow_it(make_setup, make_frames):
    """The derivative in a held focus, of free frames that smoothness ties to it, is that of differences."""
    camera, lens = make_setup()
    points = make_frames(np.full((4, 1), 0.9))

    def solved(disparity):
        first = dataclasses.replace(lens, focus_disparity=jnp.asarray(disparity))
        lenses = [first, first, lens, lens]
        held = {"focus": (True, True, False, False)}
        found = solve_frames(points, camera, lenses, smoothness=1.0, steadiness=0.0, held=held)
        return (found.lens.focus_disparity,) * 2

    # One program for the solutions and their slope.
    at, step = jax.jit(jax.jacfwd(solved, has_aux=True)), 1e-3
    slope, focus = at(jnp.asarray(0.3))
    np.testing.assert_array_equal(focus[:2], [0.3, 0.3])
    ends = [at(jnp.asarray(0.3 + sign * step))[1] for sign in (-1, 1)]
    np.testing.assert_allclose(slope, (ends[1] - ends[0]) / (2 * step), atol=1e-6)
    assert 0.01 < float(slope[2]) < 1
    with pytest.raises(ValueError, match="'tilt', which is not free; free is"):
        solve_frames(points, camera, lens, held={"tilt": (True,) * 4})
