"""A short film of two cards, one before the other, small enough to solve and render in a test."""

import pytest
from small_scenes import front_camera, patch, wide_lens

from focusjax.focus import AtPoint, FocusPoint, Sharp
from focusjax.scene import constant_background, make_scene
from focusjax.shot import Motion, MovingScene, Shot, TimedWish, transforms

FRAMES = 48
FAR = (0.0, 0.0, -2.0)


@pytest.fixture(scope="package")
def screen_passes():
    """A wall 2 m away that is to be sharp, a far one that holds the focus, and a screen that moves.

    The screen hides the point on the near wall in frames 24 to 48, half of all.
    """
    camera = front_camera()
    wall = patch("wall", camera, (4, 4, 20, 20), 0.5)
    back = patch("back", camera, (-20, -20, 60, 60), 0.2, (0.2, 0.4, 0.2))
    screen = patch("screen", camera, (-26, -20, 2, 60), 1.0, (0.5, 0.1, 0.1))
    scene = make_scene([wall, back, screen], background=constant_background(0.0), unlit=True)
    # At 1 m, 40 px are 1 m: the screen's edge goes from pixel 2 to 16, where the point is, and on to 20.
    shifts = {1: 0.0, 22: 0.29, 26: 0.41, 46: 0.45}
    path = transforms({t: {"translate": (shift, 0, 0)} for t, shift in shifts.items()}, between="linear")
    moving = MovingScene(scene, [wall, back, screen], {"screen": Motion(transforms=path)})
    points = [
        FocusPoint(AtPoint(FAR), Sharp(), name="wall"),
        FocusPoint(AtPoint((1.375, 0.0, -5.0)), Sharp(), weight=0.3, name="back"),
    ]
    return Shot(
        scene=moving,
        cameras=(camera,) * FRAMES,
        lenses=(wide_lens(camera),) * FRAMES,
        wishes=tuple(TimedWish(point) for point in points),
        options={"min_focus_distance": 0.5},
    )
