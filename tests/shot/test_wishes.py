"""Wishes that come and go: no jumps, whatever makes them appear or vanish."""

import dataclasses
import re

import numpy as np
import pytest

from focusjax.focus import AtMost, AtPixel, AtPoint, Blur, FocusPoint, OnObject, OnSensor, Sharp
from focusjax.shot import TimedWish, faded, find_wishes, keyframes, solve_shot

NOSE = FocusPoint(AtPoint((0, 0, -2)), Sharp(), name="nose")


def test_fades_stay_below_and_are_as_large_as_they_can_be():
    rng = np.random.default_rng(0)
    share = np.where(rng.random((60, 5)) < 0.3, 0.0, rng.random((60, 5)))
    found = faded(share, 4.0)
    assert np.all(found <= share)
    assert np.abs(np.diff(found, axis=0)).max() <= 0.25 + 1e-12
    apart = np.abs(np.arange(60)[:, None] - np.arange(60))
    expected = np.min(share[None] + apart[..., None] / 4.0, axis=1)
    assert found == pytest.approx(expected)
    assert faded(share, 0.0) is share


def test_a_wish_is_what_its_keyframes_make_it():
    wish = TimedWish(
        FocusPoint(AtPixel(3, 4), Blur(OnSensor(0.1)), weight=2.0, name="lamp"),
        from_frame=5,
        to_frame=9,
        diameter=keyframes({1: 0.1, 11: 0.3}, between="linear"),
        place=keyframes({1: (3.0, 4.0), 11: (13.0, 4.0)}, between="linear"),
    )
    assert [wish.at(frame).weight for frame in (4, 5, 9, 10)] == [0.0, 2.0, 2.0, 0.0]
    assert isinstance(wish.at(6).wish.diameter, OnSensor)
    assert wish.at(6).wish.diameter.millimetres == pytest.approx(0.2)
    assert wish.at(6).where == AtPixel(8.0, 4.0)
    moving = TimedWish(NOSE, place=keyframes({1: (0, 0, -2), 3: (0, 0, -4)}), weight=keyframes({1: 0.5}))
    assert moving.at(3).where.position.tolist() == [0, 0, -4]
    assert moving.at(3).weight == 0.5


@pytest.mark.slow
def test_a_point_visible_in_half_the_frames(screen_passes):
    """Something passes before it for good: its wish fades out before, and the focus goes without a jump."""
    solved = solve_shot(screen_passes)
    share = solved.share[:, 0]
    # Hidden from the middle of the shot on; the fade begins six frames before.
    assert np.flatnonzero(share == 0)[0] == pytest.approx(24, abs=2)
    assert share[0] == 1.0
    assert np.abs(np.diff(share)).max() <= 1 / 6 + 1e-12
    assert np.all(solved.share[:, 1] == 1.0)
    focus = solved.solution.settings()["focus_per_m"]
    # Before: the two wishes' mean, 0.5 and 0.2 with weights 1 and 0.3; after: the far wall alone.
    assert focus[0] == pytest.approx((0.5 + 0.3 * 0.2) / 1.3, abs=5e-3)
    assert focus[-1] == pytest.approx(0.2, abs=5e-3)
    change = solved.solution.largest_changes()["focus_per_m"]
    # Of 0.23 dioptres in all. Observed: 0.021 per frame and 0.0027 per frame^2.
    assert change.per_frame < 0.03
    assert change.per_frame2 < 0.004
    abrupt = solve_shot(dataclasses.replace(screen_passes, fade_frames=0.0, smoothness=0.0, steadiness=0.0))
    # The screen's edge softens that a little. Observed: 0.10.
    assert abrupt.solution.largest_changes()["focus_per_m"].per_frame > 3 * change.per_frame


def test_nearer_wishes_may_count_more_in_all_frames(screen_passes):
    shot = screen_passes
    views = [{"disparity_map": np.full((24, 32), 0.1)}] * 2
    near, far = (FocusPoint(AtPoint((0, 0, -z)), Sharp(), name=str(z)) for z in (1, 4))
    timed = [TimedWish(near, to_frame=1), TimedWish(far)]
    found = find_wishes(timed, shot.cameras[:2], views, fade_frames=0.0, favour_near=1.0)
    weights = [np.asarray(points.weight).tolist() for points in found.points]
    # Relative to the nearest of the shot, also when that does not act.
    assert weights == [[2.0, 1.25], [0.0, 1.25]]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TimedWish(NOSE, from_frame=9, to_frame=3), "'nose' acts from frame 9 to frame 3; swap"),
        (
            lambda: TimedWish(NOSE, weight=keyframes({1: -1.0})),
            "'nose' has a weight of -1; expected 0 or more",
        ),
        (
            lambda: TimedWish(NOSE, diameter=keyframes({1: 3.0})),
            "'nose' has a blur over time but wishes for no",
        ),
        (
            lambda: TimedWish(dataclasses.replace(NOSE, wish=AtMost(3)), diameter=keyframes({1: -3.0})),
            "'nose' has a blur of -3; expected 0 or more",
        ),
        (lambda: TimedWish(NOSE, place=keyframes({1: (3, 4)})), "'nose' has places over time; expected"),
        (
            lambda: TimedWish(dataclasses.replace(NOSE, where=OnObject("a")), place=keyframes({1: (3, 4)})),
            "'nose' has places over time; expected",
        ),
        (lambda: find_wishes([], [], []), "there are no wishes"),
        (lambda: find_wishes([TimedWish(NOSE)], [], [], fade_frames=-1), "fade_frames is -1; expected"),
    ],
)
def test_bad_wishes_are_refused(make, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


def test_what_a_frame_lacks_is_reported_with_its_number(screen_passes):
    pixel = TimedWish(
        FocusPoint(AtPixel(3, 4), Sharp(), name="here"), place=keyframes({1: (3, 4), 3: (300, 4)})
    )
    shot = dataclasses.replace(screen_passes, wishes=(pixel,))
    with pytest.raises(
        ValueError, match=re.escape("frame 2: focus point 'here' is off screen at pixel (151")
    ):
        solve_shot(shot)
    with pytest.raises(ValueError, match="the shot has 48 cameras and 2 lenses"):
        dataclasses.replace(shot, lenses=shot.lenses[:2])


def found_of(shot, *timed, disparity=0.1, **options):
    views = [{"disparity_map": np.full((24, 32), disparity)}] * 3
    return find_wishes([*timed, TimedWish(FAR)], shot.cameras[:3], views, **options)


FAR = FocusPoint(AtPoint((0, 0, -8)), Sharp(), name="far")


@pytest.mark.parametrize(
    ("timed", "disparity", "message"),
    [
        (
            TimedWish(NOSE, from_frame=60),
            0.1,
            "wish 'nose' acts from frame 60, which is none of the shot's frames 1 to 3, so that it counts",
        ),
        (
            TimedWish(NOSE, from_frame=1.2, to_frame=1.8),
            0.1,
            "acts from frame 1.2 to frame 1.8, which is none",
        ),
        (
            TimedWish(FocusPoint(AtPoint((0, 0, 2)), Sharp(), name="nose")),
            0.1,
            "wish 'nose' is behind the camera in every frame in which it acts, so that it counts in no frame",
        ),
        (
            TimedWish(NOSE, from_frame=2, to_frame=2),
            0.1,
            r"'nose' never counts in full \(17 % at most\), for it",
        ),
    ],
)
def test_wishes_that_never_act_are_reported(screen_passes, timed, disparity, message):
    with pytest.warns(UserWarning, match=message):
        found_of(screen_passes, timed, disparity=disparity)


def test_wishes_of_which_none_counts_are_refused_with_reasons(screen_passes):
    with pytest.raises(
        ValueError, match=r"no wish counts in any frame: .*'nose' is hidden in every .*; wish 'far' is"
    ):
        found_of(screen_passes, TimedWish(NOSE), disparity=2.0)
