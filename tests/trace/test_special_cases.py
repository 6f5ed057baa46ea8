"""The hard cases of the papers, small enough for closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import WIDTH, front_camera, patch, wide_lens

from focusjax.layers import peel
from focusjax.lens import ThinLens, polygon
from focusjax.scene import constant_background, make_scene
from focusjax.trace import render

FOCUS, PARALLAX = 1.0, 40.0


def hidden_behind(strips: list[tuple[float, float, float]]) -> np.ndarray:
    """Share of the lens [w] that upright strips (middle, width in px, disparity) hide, for each column."""
    places = (np.arange(4000) + 0.5) / 2000 - 1.0
    chord = np.sqrt(1.0 - places**2)
    film = np.arange(WIDTH * 20)[:, None] / 20 + 0.025
    hidden = np.zeros((WIDTH * 20, len(places)), dtype=bool)
    for middle, width, disparity in strips:
        hidden |= np.abs(film + PARALLAX * (disparity - FOCUS) * places - middle) < width / 2
    return ((hidden * chord).sum(axis=1) / chord.sum()).reshape(WIDTH, 20).mean(axis=1)


def picture_of(strips: list[tuple[float, float, float]]) -> np.ndarray:
    """Black strips before a white sky: mean of each column."""
    camera = front_camera()
    objects = [
        patch(f"strip {k}", camera, (middle - width / 2, -90, middle + width / 2, 120), disparity, 0.0)
        for k, (middle, width, disparity) in enumerate(strips)
    ]
    scene = make_scene(objects, background=constant_background(1.0), unlit=True)
    lens = wide_lens(camera, pixels_per_dioptre=PARALLAX, focus=FOCUS)
    layers = peel(scene, camera, lens, supersampling=2, max_layers=32)
    picture = np.asarray(render(layers, lens, rays=64, even=True))[..., 0]
    assert layers.complete
    return picture.mean(axis=0)


def test_two_branches_one_behind_the_other_look_separated():
    """One before the focus, one behind (Lee09 Fig. 8): their picture is darker on both sides than between."""
    strips = [(16.0, 2.0, 1.25), (16.0, 2.0, 0.75)]
    expected, seen = 1 - hidden_behind(strips), picture_of(strips)
    # Observed: 0.012.
    np.testing.assert_allclose(seen, expected, atol=0.02)
    assert seen[15:17].min() > seen[12:15].max() + 0.03


def test_24_surfaces_behind_one_another():
    """Strips that no two of share their place and depth, all on one pixel's line of sight."""
    random = np.random.default_rng(1)
    strips = [
        (16 + shift, 1.5, w)
        for shift, w in zip(random.uniform(-0.7, 0.7, 24), np.linspace(1.6, 0.6, 24), strict=True)
    ]
    expected, seen = 1 - hidden_behind(strips), picture_of(strips)
    # Observed: 0.015.
    np.testing.assert_allclose(seen, expected, atol=0.03)


def test_a_highlight_keeps_shape_and_brightness_over_100_pixels():
    """A lamp through five blades, blurred over 100 pixels: the opening's outline, and all the light."""
    camera = front_camera(112, 112)
    size, radiance, radius, turn = 8.0, 200.0, 50.0, 0.3
    opening = polygon(5, rotation=turn)
    lens = ThinLens(jnp.array(1.0), jnp.array(radius / 0.8 / float(camera.focal_px)), opening)
    lamp = patch("lamp", camera, (56 - size / 2, 56 - size / 2, 56 + size / 2, 56 + size / 2), 0.2, radiance)
    layers = peel(make_scene([lamp], unlit=True), camera, lens, supersampling=1)
    picture = np.asarray(render(layers, lens, rays=256, even=True))[..., 0]
    # Observed: 0.9997.
    assert picture.sum() == pytest.approx(radiance * size**2, rel=0.01)
    y, x = np.mgrid[:112, :112] + 0.5 - 56
    sides = turn + (2 * np.arange(5) + 1) * np.pi / 5
    outline = np.max([x * np.cos(side) + y * np.sin(side) for side in sides], axis=0)
    beyond = outline - radius * np.cos(np.pi / 5)
    soft = (size + 1) / np.sqrt(2)
    assert not picture[beyond > soft].any()
    area = 2.5 * radius**2 * np.sin(2 * np.pi / 5)
    inside = picture[beyond < -soft] / (radiance * size**2 / area)
    # Observed: 1.000, and 0.009 by rays that are aimed.
    assert inside.mean() == pytest.approx(1.0, abs=0.02)
    assert inside.std() < 0.03
