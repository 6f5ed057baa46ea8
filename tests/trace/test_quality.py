"""The quality of pictures that were made in any way is estimated by rays in some of their pixels."""

from functools import cache

import numpy as np
import pytest
from small_scenes import front_camera, varied_layers, varied_scene, wide_lens

from focusjax.layers import peel
from focusjax.metrics import psnr
from focusjax.trace import estimate_quality, render, render_pinhole


@cache
def larger():
    """Of more pixels than are sampled."""
    camera = front_camera(144, 108)
    return peel(varied_scene(), camera, wide_lens(camera), supersampling=1)


@cache
def truth() -> np.ndarray:
    layers = larger()
    return np.asarray(render(layers, layers.lens, rays=256, smooth=False, seed=50))


@pytest.mark.parametrize("kind", ["sharp", "dimmed", "shifted"])
def test_what_is_estimated_of_a_picture_is_its_error(kind: str):
    pictures = {
        "sharp": lambda: np.asarray(render_pinhole(larger())),
        "dimmed": lambda: 0.9 * truth(),
        "shifted": lambda: np.roll(truth(), 2, axis=1),
    }
    picture = pictures[kind]()
    real = psnr(picture, truth())
    found = [estimate_quality(larger(), larger().lens, picture, seed=20 * k) for k in range(4)]
    # Observed: 0.25 dB apart at most, and 0.02 to 0.5 dB less to be sure of.
    np.testing.assert_allclose([each.decibels for each in found], real, atol=1.0)
    assert all(real - 2.0 < each.at_least < min(real + 0.3, each.decibels) for each in found)


def test_few_pixels_that_are_far_too_bright_are_not_missed():
    picture = truth().copy()
    picture.reshape(-1, 3)[[700, 5000, 9001]] = 40.0
    spoilt = np.mean((picture - truth()) ** 2)
    for seed in (0, 20):
        found = estimate_quality(larger(), larger().lens, picture, seed=seed)
        # Observed: 0.0001 dB apart.
        assert found.decibels == pytest.approx(-10 * np.log10(spoilt), abs=0.5)


def test_pictures_of_no_use_are_refused():
    layers = varied_layers()
    camera, lens = layers.camera, layers.lens
    with pytest.raises(
        ValueError, match=r"the picture has shape \(2, 2, 3\); expected that of the layers, \("
    ):
        estimate_quality(layers, lens, np.zeros((2, 2, 3)))
    with pytest.raises(ValueError, match="values that are not finite; expected linear radiance"):
        estimate_quality(layers, lens, np.full((camera.height, camera.width, 3), np.nan))
    with pytest.raises(ValueError, match="rays is 0; expected a whole number, at least 1"):
        estimate_quality(layers, lens, np.zeros((camera.height, camera.width, 3)), rays=0)
