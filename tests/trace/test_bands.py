"""Large pictures are made in bands of rows: the same picture, in less memory."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, wide_lens

from focusjax.layers import Layers, peel
from focusjax.layers import _rows as layers_rows
from focusjax.layers import _slopes as layers_slopes
from focusjax.scene import make_scene
from focusjax.trace import _bands, _devices, render, render_pinhole
from focusjax.trace._bands import bands_of
from focusjax.trace._picture import picture
from focusjax.trace._render import render_settings

LENS_PX = 14.0


@pytest.fixture
def small_bands(monkeypatch):
    """Bands of so few rows that small pictures have several; compiled anew, as programs do not know of it."""

    def choose(pixels: int) -> None:
        monkeypatch.setattr(_bands, "at_once", lambda **_: pixels)
        monkeypatch.setattr(layers_rows, "at_once", lambda **_: pixels)
        monkeypatch.setattr(layers_slopes, "at_once", lambda **_: pixels)
        jax.clear_caches()

    yield choose
    jax.clear_caches()


def lit_layers(height: int = 70) -> Layers:
    """A lamp, which has rays of its own, before a wall that is blurred much and one that is in focus."""
    camera = front_camera(48, height)
    lens = wide_lens(camera, pixels_per_dioptre=LENS_PX)
    lamp = patch("lamp", camera, (20, 29, 22, 31), 1.6, (60, 40, 20))
    near = patch("near", camera, (-60, -60, 24, height + 60), 1.2, (0.6, 0.1, 0.2))
    wall = patch("wall", camera, (-60, -60, 110, height + 60), 0.25, (0.2, 0.3, 0.2))
    return peel(make_scene([lamp, near, wall], unlit=True), camera, lens)


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({"rays": 16}, marks=pytest.mark.slow),
        {"rays": 3},
        pytest.param({"rays": 8, "even": True, "smooth": True}, marks=pytest.mark.slow),
        pytest.param({"rays": 8, "smooth": False}, marks=pytest.mark.slow),
    ],
    ids=["adaptive", "few", "even", "unsmoothed"],
)
def test_bands_make_the_picture_of_the_whole(small_bands, settings):
    layers = lit_layers()
    whole = np.asarray(render(layers, layers.lens, **settings))
    sharp = np.asarray(render_pinhole(layers))
    # The last band is not as high as the others.
    small_bands(48 * 34)
    found = np.asarray(render(layers, layers.lens, **settings))
    # Rays of a pixel are added up in another order. Observed: 4e-15 of radiances up to 1.
    np.testing.assert_allclose(found, whole, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(np.asarray(render_pinhole(layers)), sharp)


@pytest.mark.slow
def test_what_may_be_seen_through_is_the_same_in_bands(small_bands):
    camera = front_camera(48, 70)
    lens = wide_lens(camera, pixels_per_dioptre=LENS_PX)
    pane = patch("pane", camera, (-60, -60, 24, 130), 1.2, (0.6, 0.1, 0.2))
    glass = dataclasses.replace(pane.materials[0], opacity=0.4)
    pane = dataclasses.replace(pane, materials=(glass,))
    wall = patch("wall", camera, (-60, -60, 110, 130), 0.25, (0.2, 0.3, 0.2))
    layers = peel(make_scene([pane, wall], unlit=True), camera, lens)
    whole, sharp = np.asarray(render(layers, lens, rays=16)), np.asarray(render_pinhole(layers))
    small_bands(48 * 34)
    np.testing.assert_allclose(np.asarray(render(layers, lens, rays=16)), whole, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(np.asarray(render_pinhole(layers)), sharp)


@pytest.mark.slow
def test_gradients_by_radiance_are_those_of_the_whole(small_bands):
    layers = lit_layers()

    def loss(radiance: jax.Array) -> jax.Array:
        tinted = eqx.tree_at(lambda held: held.samples.radiance, layers, radiance)
        return (render(tinted, layers.lens, rays=8) ** 2).sum()

    whole = np.asarray(jax.grad(loss)(layers.samples.radiance))
    small_bands(48 * 34)
    found = np.asarray(jax.grad(loss)(layers.samples.radiance))
    np.testing.assert_allclose(found, whole, rtol=1e-9, atol=1e-9)


def test_bands_cover_a_picture_whatever_its_height():
    assert bands_of(400, 300, 8) is None
    large = bands_of(4000, 3000, 8)
    assert large is not None
    assert large.window == (1 << 18) // 4000
    # Of a very wide picture there are some rows all the same.
    wide = bands_of(1 << 20, 3000, 8)
    assert wide is not None
    assert wide.rows >= 16


@pytest.mark.slow
def test_sums_are_held_for_a_band_alone(small_bands, monkeypatch):
    layers = lit_layers(2000)
    monkeypatch.setattr(_devices, "at_once", lambda **_: 1 << 10)

    def held() -> int:
        settings = render_settings(layers, layers.lens, rays=16)
        made = eqx.filter_jit(picture).lower(layers, layers.lens, jnp.uint32(0), settings=settings).compile()
        return made.compiled.memory_analysis().temp_size_in_bytes

    whole = held()
    small_bands(48 * 34)
    # Sums are 9 bins of 4 numbers and 3 more; beyond them something else takes most. Observed: 11.8 MB less.
    assert held() < whole - 39 * 8 * 48 * 500
