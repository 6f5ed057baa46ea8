"""Values, turns and cameras between keyframes."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from focusjax.shot import camera_path, keyframes, pose_path, turns

FINE = np.linspace(-5.0, 45.0, 2001)


def test_smooth_values_meet_their_keyframes_and_never_leave_their_range():
    values = {1: 2.0, 10: 5.0, 12: 5.0, 30: -1.0, 40: 0.0}
    path = keyframes(values)
    assert [float(path(frame)) for frame in values] == list(values.values())
    found = np.array([float(path(frame)) for frame in FINE])
    for (start, first), (end, last) in zip(list(values.items())[:-1], list(values.items())[1:], strict=True):
        between = found[(start <= FINE) & (end >= FINE)]
        assert between.min() >= min(first, last) - 1e-12
        assert between.max() <= max(first, last) + 1e-12
    assert np.ptp(found[FINE <= 1]) == np.ptp(found[FINE >= 40]) == 0.0
    # One derivative is continuous, at the held ends too: slopes change by the second derivative times a step.
    slopes = np.diff(found) / np.diff(FINE)
    assert np.abs(np.diff(slopes)).max() < 0.06


def test_linear_values_go_straight():
    path = keyframes({1: (0.0, 1.0), 5: (4.0, 1.0), 6: (4.0, -1.0)}, between="linear")
    assert path(2).tolist() == [1.0, 1.0]
    assert path(5.5).tolist() == [4.0, 0.0]
    assert path(0).tolist() == [0.0, 1.0]
    assert path(9).tolist() == [4.0, -1.0]


@pytest.mark.parametrize("between", ["smooth", "linear"])
def test_turns_take_the_shortest_way_about_one_axis(between):
    last = Rotation.from_euler("y", 200, degrees=True).as_matrix()
    path = turns({1: np.eye(3), 25: last}, between=between)
    vectors = np.array([Rotation.from_matrix(path(frame)).as_rotvec() for frame in range(1, 26)])
    assert np.degrees(vectors[-1]) == pytest.approx([0.0, -160.0, 0.0])
    assert np.all(np.diff(vectors[:, 1]) < 0)
    assert np.degrees(vectors[12, 1]) == pytest.approx(-80.0)


def test_angular_speed_has_no_jump_at_a_keyframe():
    keys = {1: 0.0, 11: 10.0, 21: 100.0, 31: 110.0}
    path = turns(
        {frame: Rotation.from_euler("z", angle, degrees=True).as_matrix() for frame, angle in keys.items()}
    )
    angle = np.array([Rotation.from_matrix(path(frame)).as_rotvec(degrees=True)[2] for frame in FINE])
    speed = np.diff(angle) / np.diff(FINE)
    # Straight from one to the next it would jump from 1 to 9 degrees per frame.
    assert np.abs(np.diff(speed)).max() < 0.15
    assert angle[-1] == pytest.approx(110.0)


def test_a_camera_that_stands_still_is_one_camera():
    size = {"width": 64, "height": 48}
    still = camera_path(3, focal_length=0.05, pose=lambda frame: np.eye(4), **size)
    assert still[0] is still[1] is still[2]
    zoom = camera_path(3, focal_length=keyframes({1: 0.035, 3: 0.085}), pose=lambda frame: np.eye(4), **size)
    assert [round(1000 * float(camera.focal_length)) for camera in zoom] == [35, 60, 85]


def test_a_target_stays_in_the_middle_while_the_camera_goes_around_it():
    around = keyframes({1: (0, 0, 2), 9: (2, 0, 0), 17: (0, 1, -2)})
    target = keyframes({1: (0.1, 0.2, 0.3)})
    for camera in camera_path(17, focal_length=0.05, position=around, target=target, width=64, height=48):
        xy, _ = camera.project(jnp.array([0.1, 0.2, 0.3]))
        assert np.asarray(xy) == pytest.approx([32.0, 24.0], abs=1e-9)


def test_poses_are_rigid_between_keyframes():
    last = np.eye(4)
    last[:3, :3] = Rotation.from_euler("xyz", (20, 130, -40), degrees=True).as_matrix()
    last[:3, 3] = (1, 2, 3)
    path = pose_path({1: np.eye(4), 20: last})
    for frame in (1, 7.3, 19, 20):
        rotation = path(frame)[:3, :3]
        assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert path(20) == pytest.approx(last)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: keyframes({}), "there are no keyframes"),
        (lambda: keyframes({5: 1.0, 2: 0.0}), "the keyframe at frame 2 comes after the one at frame 5"),
        (lambda: keyframes({1: 1.0, 2: (1.0, 2.0)}), "keyframes have values of shapes [(), (2,)]"),
        (lambda: keyframes({1: np.nan}), "the keyframe at frame 1 is nan; expected finite numbers"),
        (lambda: keyframes({1: 1.0}, between="cubic"), "between is 'cubic'; expected 'smooth' or 'linear'"),
        (lambda: turns({1: 2 * np.eye(3)}), "the keyframe at frame 1 is no rotation"),
        (lambda: pose_path({1: np.eye(3)}), "the pose at frame 1 has shape (3, 3)"),
        (
            lambda: camera_path(
                3, focal_length=0.05, position=keyframes({1: (0, 0, 1), 3: (0, 0, -1)}),
                target=keyframes({1: (0, 0, 0)}), width=64, height=48,
            ),
            "frame 2: the camera looks at its own position",
        ),
        (lambda: camera_path(3, focal_length=0.05, width=64, height=48), "give either a pose, or both"),
    ],
)  # fmt: skip
def test_bad_keyframes_are_refused(make, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        make()
