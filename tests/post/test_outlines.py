"""Outlines of blurred foregrounds: by a closed form, and where nothing may change."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch

from focusjax.geometry import Camera
from focusjax.layers import peel
from focusjax.lens import Disk, ThinLens, polygon
from focusjax.post import PinholeView, gather, post_process, view_in_layers
from focusjax.scene import make_scene
from focusjax.trace import render

NEAR, FAR = 1.0, 0.25
RADIUS = 8.0
"""Of the foreground's circle of confusion in pixels, the wall being in focus."""


def wide_camera() -> Camera:
    return front_camera(96, 64)


def lens_of(focus: float = FAR) -> ThinLens:
    aperture = RADIUS / (NEAR - FAR) / float(wide_camera().focal_px)
    return ThinLens(jnp.array(focus), jnp.array(aperture), Disk())


def half_plane(front: object = (0.9, 0.3, 0.1), wall: object = (0.2, 0.4, 0.6)) -> PinholeView:
    """A foreground on the left half, before a wall."""
    left = np.arange(96) < 48
    image = np.where(left[None, :, None], np.asarray(front), np.asarray(wall)) * np.ones((64, 96, 3))
    disparity = np.where(left[None, :], NEAR, FAR) * np.ones((64, 96))
    return PinholeView(jnp.asarray(image), jnp.asarray(disparity))


def disc_left_of(x: np.ndarray) -> np.ndarray:
    """Share of a unit disc whose abscissa is less than x."""
    x = np.clip(x, -1.0, 1.0)
    return 0.5 + (x * np.sqrt(1.0 - x * x) + np.arcsin(x)) / np.pi


def test_an_outline_is_the_integral_of_the_opening_on_both_sides():
    found = np.asarray(post_process(half_plane(), wide_camera(), lens_of(), taps=64))
    share = disc_left_of((48 - (np.arange(96) + 0.5)) / RADIUS)[None, :, None]
    wanted = share * np.array([0.9, 0.3, 0.1]) + (1.0 - share) * np.array([0.2, 0.4, 0.6])
    # Observed: 0.012 at most and a mean of 0.003; 0.006 in the mean over rows, of means over 3 x 3 pixels.
    error = found - wanted
    assert np.abs(error).max() < 0.03
    assert np.sqrt(np.mean(error[:, 40:56] ** 2)) < 0.006
    assert np.abs(error.mean(axis=0)).max() < 0.01


def test_a_constant_picture_stays_constant():
    for lens in (lens_of(), lens_of(0.5), ThinLens(jnp.array(FAR), lens_of().aperture_radius, polygon(5))):
        found = post_process(half_plane(0.7, 0.7), wide_camera(), lens, taps=16)
        np.testing.assert_allclose(found, 0.7, atol=1e-12)


def test_a_foreground_in_focus_and_what_is_blurred_behind_it_are_gathered():
    view, lens = half_plane(), lens_of(NEAR)
    found = post_process(view, wide_camera(), lens, taps=16)
    np.testing.assert_array_equal(found, gather(view.image, view.disparity, wide_camera(), lens, taps=16))
    np.testing.assert_allclose(found[:, :48], view.image[:, :48], atol=1e-12)


def test_what_no_circle_of_confusion_reaches_is_unchanged():
    view = half_plane()
    found = post_process(view, wide_camera(), lens_of(), taps=16)
    beyond = 48 + int(RADIUS) + 1
    np.testing.assert_allclose(found[:, beyond:], view.image[:, beyond:], atol=1e-12)


def test_outlines_are_nearer_to_tracing_than_by_gathering():
    camera, lens = wide_camera(), lens_of()
    card = patch("card", camera, (30, 20, 60, 44), NEAR, (0.9, 0.3, 0.1))
    bar = patch("bar", camera, (70, -20, 74, 90), 0.6, (0.1, 0.1, 0.3))
    wall = patch("wall", camera, (-40, -40, 140, 110), FAR, 0.5)
    scene = make_scene([card, bar, wall], unlit=True)
    layers = peel(scene, camera, lens, supersampling=1)
    truth = np.asarray(render(layers, lens, rays=256, smooth=False))
    view = view_in_layers(layers, scene)

    def decibels(picture: object) -> float:
        return float(-10 * np.log10(np.mean((np.asarray(picture) - truth) ** 2)))

    reached = decibels(post_process(view, camera, lens, taps=32))
    # Observed: 45 dB, and 28.0 dB by gathering.
    assert reached > 38.0
    assert reached > decibels(gather(view.image, view.disparity, camera, lens, taps=32)) + 8.0


@pytest.mark.parametrize("taps", [1, 2, 16])
@pytest.mark.parametrize("focus", [0.0, FAR, 0.5, 3.0])
def test_pictures_are_finite_and_within_what_is_seen(taps, focus):
    rng = np.random.default_rng(3)
    image, disparity = rng.uniform(0.0, 1.0, (64, 96, 3)), rng.uniform(0.0, 2.0, (64, 96))
    disparity[::7] = 0.0
    view = PinholeView(jnp.asarray(image), jnp.asarray(disparity))
    found = np.asarray(post_process(view, wide_camera(), lens_of(focus), taps=taps))
    assert np.isfinite(found).all()
    assert found.min() >= -1e-12
    assert found.max() <= 1.0 + 1e-12
