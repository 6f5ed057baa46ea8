"""How far what is seen moves, by closed forms."""

import numpy as np
import pytest
from small_scenes import front_camera, patch

from focusjax.geometry import look_at
from focusjax.scene import constant_background, make_scene
from focusjax.shot import Motion, MovingScene, transforms
from focusjax.shutter import make_shutter, velocity_map

CAMERA = front_camera()
SECOND = make_shutter(1.0)
"""Times are in seconds here: a frame a second, around frame 1."""


def velocities(keys, *, disparity=0.5, camera=CAMERA, shutter=SECOND):
    card = patch("card", CAMERA, (8, 6, 20, 18), disparity)
    scene = make_scene([card], background=constant_background(0.0), unlit=True)
    motion = Motion(transforms=transforms(keys, between="linear"))
    return velocity_map(MovingScene(scene, [card], {"card": motion}), camera, shutter, fps=1.0)


def test_a_card_that_slides():
    """By 12 px to the right and 4 px up a second, 2 m away; in the middle it has gone half of that."""
    metres = 2.0 / float(CAMERA.focal_px)
    found = velocities({0.5: {}, 1.5: {"translate": (12 * metres, 4 * metres, 0)}})
    wanted = np.zeros((24, 32, 2))
    wanted[4:16, 14:26] = 12, -4
    # Observed: 8e-15.
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    half = velocities({0.5: {}, 1.5: {"translate": (12 * metres, 4 * metres, 0)}}, shutter=make_shutter(0.5))
    np.testing.assert_allclose(half, wanted / 2, atol=1e-9)


def test_a_card_that_turns_about_the_axis_moves_along_chords():
    found = velocities({0.5: {"rotate": (0, 0, -20)}, 1.5: {"rotate": (0, 0, 20)}})
    row, column = 8, 12
    from_axis = np.array([column + 0.5 - 16, row + 0.5 - 12])
    chord = 2 * np.sin(np.radians(20)) * np.array([from_axis[1], -from_axis[0]])
    np.testing.assert_allclose(found[row, column], chord, atol=1e-9)


def test_a_card_that_comes_through_the_lens_has_a_finite_way():
    """At the start it is 5 m away, in the middle 2 m, and at the end a metre behind the camera."""
    found = velocities({0.5: {"translate": (0, 0, -3)}, 1.5: {"translate": (0, 0, 3)}})
    # Of a quarter of the time the ends are 2.75 and 1.25 m away: four times the way between.
    x = np.array([10.5 - 16, 8.5 - 12])
    halves = [x * (2 / depth - 2 / away) for away, depth in ((3.5, 0.5), (2.75, 1.25))]
    np.testing.assert_allclose(found[8, 10], 2 * halves[0], atol=1e-9)


def test_what_is_infinitely_far_moves_as_the_camera_turns():
    def panning(time):
        """By 0.2 radians a second to the right."""
        angle = 0.2 * (time - 1.0)
        ahead = (np.sin(angle), 0.0, -np.cos(angle))
        return look_at((0, 0, 0), ahead, width=32, height=24, field_of_view=2 * np.arctan(0.4))

    found = velocities({1.0: {}}, camera=panning)
    focal = float(CAMERA.focal_px)
    for row, column in ((2, 3), (20, 30), (12, 16)):
        along = np.arctan((column + 0.5 - 16) / focal)
        wanted = focal * (np.tan(along - 0.1) - np.tan(along + 0.1))
        # Directions of the card move as those behind it: the camera turns about its lens.
        assert found[row, column, 0] == pytest.approx(wanted, abs=1e-5)
    assert found[12, 10, 0] == pytest.approx(
        focal * np.subtract(*np.tan(np.arctan((10.5 - 16) / focal) + np.array([-0.1, 0.1]))), abs=1e-5
    )


def test_what_stands_still_has_none():
    assert not velocities({1.0: {}}).any()
