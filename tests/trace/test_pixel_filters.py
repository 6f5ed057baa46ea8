"""Pixel filters: against a finer picture that is filtered afterwards, at the border, at edges in focus."""

import dataclasses
from collections.abc import Callable
from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
from small_scenes import (
    HEIGHT,
    SQUARE,
    WIDTH,
    at_pixels,
    front_camera,
    varied_layers,
    varied_scene,
    wide_lens,
)

from focusjax.baselines import lens_picture
from focusjax.geometry import Camera
from focusjax.layers import Layers, peel
from focusjax.lens import ThinLens
from focusjax.metrics import psnr
from focusjax.scene import Scene, constant_background, make_object, make_scene
from focusjax.trace import estimate_quality, render

FINE, BEYOND = 6, 2
"""Parts of a pixel along each axis in the finer pictures, and pixels that they reach beyond the frame."""


def below(name: str, x: np.ndarray) -> np.ndarray:
    """Share of a filter's weight at places up to x, in pixels from its centre."""
    if name == "box":
        return np.clip(x + 0.5, 0.0, 1.0)
    if name == "tent":
        x = np.clip(x, -1.0, 1.0)
        return 0.5 + x - 0.5 * x * np.abs(x)
    whole = scipy.special.erf(np.sqrt(2.0) * 1.5)
    return (scipy.special.erf(np.sqrt(2.0) * np.clip(x, -1.5, 1.5)) / whole + 1.0) / 2.0


def filtered(name: str, fine: np.ndarray) -> np.ndarray:
    """A picture of FINE parts per pixel, filtered: each part counts as the filter's weight over it."""

    def weights(pixels: int) -> np.ndarray:
        borders = np.arange((pixels + 2 * BEYOND) * FINE + 1) / FINE - BEYOND
        return np.diff(below(name, borders[None] - (np.arange(pixels)[:, None] + 0.5)), axis=1)

    return np.einsum("hi,wj,ijc->hwc", weights(HEIGHT), weights(WIDTH), fine)


def finer(camera: Camera) -> Camera:
    """The same view in FINE parts per pixel, from BEYOND pixels outside the frame on."""
    wide = camera.width + 2 * BEYOND
    return dataclasses.replace(
        camera,
        width=wide * FINE,
        height=(camera.height + 2 * BEYOND) * FINE,
        sensor_width=camera.sensor_width * wide / camera.width,
        principal_point=(camera.principal_point + BEYOND) * FINE,
    )


@cache
def shards() -> Scene:
    """Triangles of random colours within half a pixel of focus, over the frame and its border."""
    random = np.random.default_rng(0)
    corners = random.uniform((-6, -6), (WIDTH + 6, HEIGHT + 6), (40, 1, 2)) + random.uniform(
        -5, 5, (40, 3, 2)
    )
    disparity = np.repeat(random.uniform(0.47, 0.53, 40), 3)
    vertices = at_pixels(corners.reshape(-1, 2), disparity, front_camera())
    colours = np.repeat(random.uniform(0, 1, (40, 3)), 3, axis=0)
    shape = make_object("shards", vertices, np.arange(120).reshape(-1, 3), vertex_colours=colours)
    return make_scene([shape], background=constant_background(0.5), unlit=True)


@cache
def fine_picture() -> np.ndarray:
    camera = front_camera()
    return lens_picture(shards(), finer(camera), wide_lens(camera), rays=8)


@cache
def wide_layers(make: Callable[[], Scene]) -> Layers:
    """The layers of a scene that hold the rays of all filters; those of one shape share programs."""
    camera = front_camera()
    like = wide_layers(shards) if make is half_plane else None
    return peel(make(), camera, wide_lens(camera), supersampling=2, pixel_filter="gaussian", like=like)


@pytest.mark.parametrize("name", ["tent", "gaussian"])
def test_a_filtered_fine_picture_is_the_same(name: str):
    """By casting rays at the triangles, with nothing of the tracer, its samples or its filters."""
    layers = wide_layers(shards)
    picture = np.asarray(render(layers, layers.lens, rays=256, pixel_filter=name))
    truth = filtered(name, fine_picture())
    border = np.ones((HEIGHT, WIDTH), dtype=bool)
    border[1:-1, 1:-1] = False
    # Observed: 45.2 and 46.6 dB, at the border 42.6 and 44.2.
    assert psnr(picture, truth) > 44
    assert psnr(picture, truth, mask=border) > 41.5
    # Observed: 37.9 and 34.8 dB.
    assert psnr(np.asarray(render(layers, layers.lens, rays=256, pixel_filter="box")), truth) < 39


def test_layers_for_a_wide_filter_serve_the_box():
    box = np.asarray(render(varied_layers(), varied_layers().lens, rays=16))
    wide = wide_layers(varied_scene)
    assert wide.grid == varied_layers().grid
    np.testing.assert_array_equal(np.asarray(render(wide, wide.lens, rays=16, pixel_filter="box")), box)


@pytest.mark.parametrize("even", [False, True])
def test_a_uniform_scene_stays_uniform_to_the_border(even: bool):
    layers, radiance = wide_layers(varied_scene), np.array([0.25, 1.0, 7.0])
    uniform = eqx.tree_at(
        lambda layers: (layers.samples.radiance, layers.background),
        layers,
        [jnp.broadcast_to(radiance, a.shape) for a in (layers.samples.radiance, layers.background)],
    )
    picture = np.asarray(render(uniform, layers.lens, rays=16, even=even))
    # Observed: 0.
    np.testing.assert_allclose(picture, np.broadcast_to(radiance, picture.shape), rtol=1e-12)


@cache
def half_plane() -> Scene:
    """Black and in focus, its edge through the middle of the frame, a pixel across for eight down."""
    camera = front_camera()
    corners = np.array([(-40, -40), (16 - 6.5, -40), (16 + 6.5, 64), (-40, 64)])
    half = make_object("half", at_pixels(corners, np.full(4, 0.5), camera), SQUARE, colour=(0, 0, 0))
    return make_scene([half], background=constant_background(1.0), unlit=True)


@pytest.mark.parametrize("name", ["box", "tent", "gaussian"])
def test_a_slanted_edge_in_focus_is_antialiased(name: str):
    """The picture goes from 0 to 1 as the filter's weight across the edge."""
    layers = wide_layers(half_plane)
    picture = np.asarray(render(layers, layers.lens, rays=256, pixel_filter=name))[..., 0]
    # The filter's weight beyond the edge, in thin rows.
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    rows = np.linspace(-1.5, 1.5, 301)
    weights = np.diff(below(name, rows))
    share = np.zeros((HEIGHT, WIDTH))
    for down, weight in zip((rows[1:] + rows[:-1]) / 2, weights, strict=True):
        share += weight * below(name, (x - WIDTH / 2) - (y + down - HEIGHT / 2) / 8.0)
    # Observed, largest and root of the mean square: 0.012 and 0.0016 for the box, 0.009 and 0.0007 for the
    # tent, 0.008 and 0.0009 for the Gaussian. Without a filter they would be 0.5 and 0.05.
    assert np.abs(picture - share).max() < 0.02
    assert np.sqrt(np.mean((picture - share) ** 2)) < 0.003


def test_the_quality_of_a_filtered_picture_is_estimated():
    layers = wide_layers(varied_scene)
    picture = np.asarray(render(layers, layers.lens, rays=16))
    expected = psnr(picture, np.asarray(render(layers, layers.lens, rays=1024, even=True, seed=5)))
    # Observed: 37.76 for 36.28 dB.
    assert estimate_quality(layers, layers.lens, picture, rays=16).decibels == pytest.approx(
        expected, abs=1.5
    )


def test_filters_wider_than_the_layers_are_refused():
    layers = varied_layers()
    with pytest.raises(ValueError, match=r"rays start up to 1 pixels .* peeled for 0.5; peel with .*='tent'"):
        render(layers, layers.lens, rays=4, pixel_filter="tent")
    with pytest.raises(ValueError, match="pixel_filter is 'sinc'; expected one of box, tent, gaussian"):
        render(layers, layers.lens, rays=4, pixel_filter="sinc")


def test_a_pinhole_sees_beyond_the_frame_too():
    """A stripe just outside the frame lights its first column through the tent: an eighth of its weight."""
    camera = front_camera()
    box = np.array([(-5.0, -9.0), (0.0, -9.0), (0.0, 40.0), (-5.0, 40.0)])
    stripe = make_object(
        "stripe", at_pixels(box, np.full(4, 0.5), camera), SQUARE, colour=(0, 0, 0), emission=1.0
    )
    scene = make_scene([stripe], background=constant_background(0.0), unlit=True)
    closed = ThinLens(jnp.array(0.5), jnp.array(0.0))
    layers = peel(scene, camera, closed, supersampling=2, pixel_filter="tent")
    picture = np.asarray(render(layers, closed, rays=64))
    # Observed: exact, as rays are spread evenly.
    np.testing.assert_allclose(picture[:, 0], 0.125, atol=0.02)
    assert not picture[:, 1:].any()
