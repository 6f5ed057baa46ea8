"""Pictures from few rays: what smoothing may not change, and by how much it is better."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import WIDTH, front_camera, patch, varied_layers, wide_lens

from focusjax.layers import peel
from focusjax.lens import ThinLens
from focusjax.scene import constant_background, make_scene
from focusjax.trace import render
from focusjax.trace._accumulate import PixelSums
from focusjax.trace._coc_bins import CocBins, FocalZone
from focusjax.trace._denoise import _kernel, denoised

WIDE, HIGH = 40, 30
LEAST = (8.0, 2.0, 0.0, 4.0)


def reconstruct(sums: np.ndarray, width: int, least: tuple[float, ...], rays: float) -> np.ndarray:
    """`denoised` of sums [p, k, c]."""
    whole = PixelSums(jnp.moveaxis(jnp.asarray(sums), 1, 0), jnp.zeros((len(sums), 3)))
    return np.asarray(jax.jit(lambda whole: denoised(whole, width, least, rays))(whole))


def shares(seed: int = 0) -> np.ndarray:
    """Light [p, k] of four classes, one at least in each pixel."""
    random = np.random.default_rng(seed)
    found = random.integers(0, 3, (WIDE * HIGH, len(LEAST))).astype(float)
    found[np.arange(len(found)), random.integers(0, len(LEAST), len(found))] += 1
    return found / found.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("half_width", [1.0, 1.5, 2.7, 6.0, 13.0, 32.0])
def test_kernels_leave_parabolas_as_they_are(half_width: float):
    kernel = _kernel(half_width)
    x = np.arange(len(kernel)) - len(kernel) // 2
    assert len(kernel) // 2 >= half_width
    for power, value in ((0, 1.0), (1, 0.0), (2, 0.0), (3, 0.0)):
        # Observed: 2e-12 for the widest.
        assert kernel @ x**power == pytest.approx(value, abs=1e-10 * max(1.0, half_width**power))


def test_kernels_of_less_than_a_pixel_do_nothing():
    np.testing.assert_array_equal(_kernel(0.9), [1.0])


@pytest.mark.parametrize("rays", [1, 16, 4096])
def test_what_is_uniform_stays_so(rays: int):
    colour = np.array([0.25, 1.0, 0.0])
    light = shares()[..., None]
    found = reconstruct(np.concatenate([light * colour, light], axis=2), WIDE, LEAST, rays)
    # Observed: 4e-16.
    np.testing.assert_allclose(found, np.broadcast_to(colour, found.shape), atol=1e-12)


def test_what_is_in_focus_stays_as_the_rays_have_it():
    random = np.random.default_rng(1)
    radiance, light = random.random((WIDE * HIGH, 1, 3)), np.ones((WIDE * HIGH, 1, 1))
    sums = np.zeros((WIDE * HIGH, len(LEAST), 4))
    sums[:, 2:3] = np.concatenate([radiance, light], axis=2)
    # Observed: 6e-4, which is borrowed from the pixels around.
    np.testing.assert_allclose(reconstruct(sums, WIDE, LEAST, 16), radiance[:, 0], atol=2e-3)


def test_many_rays_are_left_as_they_are():
    light = shares()[..., None]
    sums = np.concatenate([light * np.random.default_rng(2).random((*light.shape[:2], 3)), light], axis=2)
    # Observed: 5e-4, which is borrowed.
    np.testing.assert_allclose(reconstruct(sums, WIDE, LEAST, 1e6), sums[..., :3].sum(axis=1), atol=5e-3)


def test_a_ramp_stays_a_ramp_to_the_border():
    y, x = np.mgrid[:HIGH, :WIDE]
    ramp = (0.2 + 0.01 * x + 0.005 * y).reshape(-1, 1)
    sums = np.zeros((WIDE * HIGH, len(LEAST), 4))
    sums[:, 0, :3], sums[:, 0, 3] = ramp, 1.0
    # Observed: 3e-16.
    np.testing.assert_allclose(
        reconstruct(sums, WIDE, LEAST, 8), np.broadcast_to(ramp, (WIDE * HIGH, 3)), atol=1e-12
    )


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_brighter_than_white_or_darker_than_black(seed: int):
    light = shares(seed)[..., None]
    dots = np.random.default_rng(seed).random((*light.shape[:2], 3)) < 0.03
    found = reconstruct(np.concatenate([light * dots, light], axis=2), WIDE, LEAST, 2)
    assert found.min() >= 0.0
    assert found.max() <= 1.0 + 1e-12


def test_colours_with_light_of_their_own():
    light = shares()[..., None] * np.ones(3)
    light[:, 1, 0] = 0.0
    colour = np.array([0.25, 1.0, 0.5])
    found = reconstruct(np.concatenate([light * colour, light], axis=2), WIDE, LEAST, 16)
    lit = light.sum(axis=1) > 0
    np.testing.assert_allclose(found[lit], np.broadcast_to(colour, found.shape)[lit], atol=1e-12)


def test_pictures_smaller_than_a_kernel():
    light = shares()[:6, :, None]
    found = reconstruct(np.concatenate([light * 0.5] * 3 + [light], axis=2), 3, LEAST, 1)
    np.testing.assert_allclose(found, 0.5, atol=1e-12)


def test_bins_are_octaves_of_blur_on_either_side():
    zone = FocalZone(*(jnp.full(3, value) for value in (0.5, 0.4, 10.0)))
    bins = CocBins(zone)
    assert bins.least == (16.0, 8.0, 4.0, 2.0, 0.0, 2.0, 4.0, 8.0, 16.0)
    disparity = jnp.array([[2.2, 1.0, 0.91, 0.89, 0.71, 0.69, 0.45, 0.21, 0.19, 0.0]]).T
    expected = [0, 2, 2, 3, 3, 4, 4, 4, 5, 6]
    np.testing.assert_array_equal(bins.of(jnp.array([1]), disparity)[:, 0], expected)


def test_what_is_not_blurred_is_in_the_focal_zone():
    zone = FocalZone(*(jnp.full(3, value) for value in (0.5, 0.4, 1.0)))
    found = CocBins(zone).of(jnp.array([1]), jnp.array([[1.0], [0.45], [0.0]]))
    np.testing.assert_array_equal(found, np.full((3, 1), 4))


@pytest.mark.slow
def test_few_rays_do_what_many_did():
    layers = varied_layers()
    truth = np.asarray(render(layers, layers.lens, rays=4096, even=True, seed=3))

    def error(rays: int, *, smooth: bool) -> float:
        pictures = (render(layers, layers.lens, rays=rays, smooth=smooth, seed=k) for k in range(4))
        return float(np.mean([(np.asarray(picture) - truth) ** 2 for picture in pictures]))

    # Observed: 4.5 dB.
    assert error(8, smooth=True) < 0.5 * error(8, smooth=False)
    # Observed: 0.6 dB.
    assert error(256, smooth=True) < error(256, smooth=False)


def test_a_blurred_edge_keeps_its_place_and_light():
    """Half of the frame white, far behind the focus; the other half black."""
    camera = front_camera()
    wall = patch("wall", camera, (-60, -60, WIDTH / 2, 84), 0.1, 1.0)
    lens = wide_lens(camera)
    layers = peel(
        make_scene([wall], background=constant_background(0.0), unlit=True), camera, lens, supersampling=2
    )
    many = np.asarray(render(layers, lens, rays=2048, even=True))[..., 0].mean(axis=0)
    few = np.mean([np.asarray(render(layers, lens, rays=16, seed=k))[..., 0] for k in range(8)], axis=(0, 1))
    # Observed: 0.012, and 6e-5 of the light.
    np.testing.assert_allclose(few, many, atol=0.02)
    assert few.sum() == pytest.approx(many.sum(), rel=5e-4)


@pytest.mark.slow
def test_what_is_brighter_than_white_is_left_to_its_rays():
    """No dark rim around a lamp 50 times white, and none of its light beyond the blur."""
    camera = front_camera()
    lamp = patch("lamp", camera, (10, 8, 20, 16), 0.1, 50.0)
    lens = wide_lens(camera)
    scene = make_scene([lamp], background=constant_background(0.3), unlit=True)
    layers = peel(scene, camera, lens, supersampling=2)
    picture, plain = (np.asarray(render(layers, lens, rays=16, smooth=smooth)) for smooth in (True, False))
    dark = plain.max(axis=2) <= 0.3 + 1e-6
    # Observed: 0.295 and 0.345.
    assert picture.min() > 0.29
    assert picture[dark].max() < 0.4


def test_a_pinhole_is_not_smoothed():
    layers = varied_layers()
    closed = ThinLens(jnp.array(0.5), jnp.array(0.0))
    one, other = (np.asarray(render(layers, closed, rays=8, smooth=smooth)) for smooth in (True, False))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("light", [0.5, 0.01, 1e-4])
def test_how_much_light_there_is_does_not_matter(light: float):
    weights = shares()[..., None]
    sums = np.concatenate(
        [weights * np.random.default_rng(2).random((*weights.shape[:2], 3)), weights], axis=2
    )
    # Observed: 2e-16.
    np.testing.assert_allclose(
        reconstruct(light * sums, WIDE, LEAST, 16), reconstruct(sums, WIDE, LEAST, 16), atol=1e-12
    )


def test_a_near_bar_stays_dark_through_a_lens_that_lets_little_pass():
    """Half the light stopped by something black and near, the other half by something white in focus."""
    sums = np.zeros((WIDE * HIGH, len(LEAST), 4))
    sums[:, 0, 3] = 0.05
    sums[:, 2] = 0.05
    # Observed: 1e-16.
    np.testing.assert_allclose(reconstruct(sums, WIDE, LEAST, 16), 0.5, atol=1e-12)
