"""The picture is right by somebody else's word: converged thin-lens renderings by Mitsuba 3."""

from functools import cache

import jax
import numpy as np
import pytest
from reference_scenes import load_reference

from focusjax.layers import peel
from focusjax.metrics import psnr, ssim
from focusjax.trace import render

RAYS = 64
BORDER = 12

# PSNR in dB, the same over the outermost 12 pixels, and SSIM observed at 64 rays (float32).
OBSERVED = {
    ("cow_bars", "dof_strong_foreground"): (40.4, 41.1, 0.979),
    ("cow_bars", "dof_ball_on_border"): (41.7, 43.1, 0.983),
    ("cow_bars", "dof_infinity"): (40.2, 41.7, 0.987),
    ("town_tree", "dof_focus_town"): (42.8, 46.3, 0.991),
    ("town_tree", "dof_focus_tree"): (46.1, 52.1, 0.994),
}
SETTINGS = [pytest.param(*setting, id="-".join(setting)) for setting in OBSERVED]


@cache
def picture(name: str, view: str) -> np.ndarray:
    """Our picture of one setting, in the precision that users have."""
    with jax.enable_x64(False):
        load_reference.cache_clear()
        reference = load_reference(name)
        lens = reference.lenses[view]
        layers = peel(reference.scene, reference.camera, lens, supersampling=2)
        return np.asarray(render(layers, lens, rays=RAYS))


def border(shape: tuple[int, ...]) -> np.ndarray:
    """The pixels [h, w] within 12 of the picture's border."""
    mask = np.ones(shape[:2], dtype=bool)
    mask[BORDER:-BORDER, BORDER:-BORDER] = False
    return mask


@pytest.mark.parametrize(("name", "view"), SETTINGS)
def test_picture(name: str, view: str) -> None:
    ours, theirs = picture(name, view), load_reference(name).pictures[view]
    expected_psnr, _, expected_ssim = OBSERVED[name, view]
    assert psnr(ours, theirs) >= max(35.0, expected_psnr - 1.0)
    assert ssim(ours, theirs) >= max(0.97, expected_ssim - 0.005)


@pytest.mark.parametrize(("name", "view"), SETTINGS)
def test_border(name: str, view: str) -> None:
    # Objects that only the rays of border pixels see must be there, and those cut by the frame be whole.
    ours, theirs = picture(name, view), load_reference(name).pictures[view]
    assert psnr(ours, theirs, mask=border(ours.shape)) >= max(35.0, OBSERVED[name, view][1] - 1.0)


@pytest.mark.parametrize(("name", "view"), SETTINGS)
def test_brightness_is_unbiased(name: str, view: str) -> None:
    # Blur moves light about but for border and occlusion; the mean of a picture is nearly free of noise.
    # Observed: at most 0.19 % too dark, where thin bars are blurred strongly.
    ours, theirs = picture(name, view), load_reference(name).pictures[view]
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), theirs.mean(axis=(0, 1)), rtol=4e-3)


def test_mean_over_all_settings() -> None:
    # Observed: 42.2 dB.
    scores = [psnr(picture(*key), load_reference(key[0]).pictures[key[1]]) for key in OBSERVED]
    assert np.mean(scores) >= 41.2
