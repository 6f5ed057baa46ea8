"""The accumulation buffer: its limit is the truth, few views are ghosts, what is in focus stays put."""

import numpy as np
import pytest
from small_scenes import front_camera, make_scene, patch, varied_scene, wide_lens

from focusjax.baselines import RayScene, accumulate, lens_picture
from focusjax.metrics import psnr
from focusjax.scene import constant_background

CAMERA = front_camera(64, 48)
LENS = wide_lens(CAMERA)


def test_approaches_the_truth():
    ready = RayScene(varied_scene())
    truth = lens_picture(ready, CAMERA, LENS, rays=128)
    errors = [psnr(accumulate(ready, CAMERA, LENS, views=n), truth) for n in (4, 16, 64)]
    np.testing.assert_allclose(errors, (25.0, 34.6, 39.1), atol=1.0)


def test_uniform_stays_uniform():
    scene = make_scene(
        [patch("wall", CAMERA, (10, 10, 30, 30), 1.0, 0.7)], background=constant_background(0.7), unlit=True
    )
    np.testing.assert_allclose(accumulate(scene, CAMERA, LENS, views=5), 0.7, rtol=1e-6)


def test_two_views_are_two_sharp_pictures():
    """Away from the focus every view shows the strip once, shifted by the lens point times the blur."""
    strip = patch("strip", CAMERA, (30, -20, 34, 70), 1.0, 1.0)
    scene = make_scene([strip], unlit=True)
    row = accumulate(scene, CAMERA, LENS, views=2)[24, :, 0]
    # Two strips of half the brightness, each four pixels wide, within the blur radius of 6.
    assert row.sum() == pytest.approx(4.0, abs=0.5)
    assert set(np.unique(row.round(6))) <= {0.0, 0.5, 1.0}
    assert row[:23].max() == row[41:].max() == 0.0


def test_refuses_no_views():
    with pytest.raises(ValueError, match="views is 0; expected a whole number, at least 1"):
        accumulate(varied_scene(), CAMERA, LENS, views=0)
