"""Rays go where what they meet differs; groups hold every ray of every pixel once."""

import dataclasses
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, wide_lens

from focusjax.layers import Layers, peel
from focusjax.scene import SceneObject, constant_background, make_scene
from focusjax.trace import render
from focusjax.trace._allocate import FEWEST, allocated, contrast, counts_for, least_through
from focusjax.trace._groups import even_counts, groups_of, tiled_pixels
from focusjax.trace._ranges import EDGE, disparity_ranges
from focusjax.trace._sums import compacted, prefix_sums, running_max


@cache
def small_layers() -> Layers:
    """A square that is out of focus before a wall that is in focus."""
    camera = front_camera()
    wall = patch("wall", camera, (-60, -60, 90, 90), 0.4, (0.2, 0.5, 0.2))
    square = patch("square", camera, (11, 7, 19, 15), 0.9, (1.0, 1.0, 1.0))
    return peel(make_scene([wall, square], unlit=True), camera, wide_lens(camera, focus=0.4), supersampling=2)


def layers_of(*objects: SceneObject, background: float = 0.0) -> Layers:
    """Of the shapes of `small_layers`, which share compiled programs."""
    camera = front_camera()
    scene = make_scene(objects, background=constant_background(background), unlit=True)
    return peel(scene, camera, wide_lens(camera), supersampling=2, like=small_layers())


def uneven(layers: Layers, seed: int = 0) -> np.ndarray:
    """The picture of one compiled program for all layers above."""
    return np.asarray(render(layers, layers.lens, rays=16, smooth=False, seed=seed))


allotted = jax.jit(allocated, static_argnums=(1, 2))


def allot(variance: np.ndarray, rays: int, **more: jax.Array) -> np.ndarray:
    return np.asarray(allotted(jnp.asarray(variance), rays, rays, **more))


@pytest.mark.parametrize("rays", [4, 10, 64])
def test_the_mean_is_what_was_asked_for(rays: int):
    variance = 10.0 ** np.random.default_rng(0).uniform(-8, 0, 5000)
    variance[::9] = 0.0
    counts = allot(variance, rays)
    # Observed: within 0.4 %.
    assert counts.mean() == pytest.approx(rays, rel=0.01)
    assert set(np.unique(counts)) <= set(counts_for(rays))
    assert (counts[variance == 0] == FEWEST).all()
    assert not (np.diff(counts[np.argsort(variance, kind="stable")]) < 0).any()


@pytest.mark.parametrize(("pixels", "rays"), [(100, 64), (768, 4), (768, 8), (768, 16), (50_000, 16)])
def test_a_picture_without_contrast_takes_the_fewest_that_make_the_mean(pixels: int, rays: int):
    assert (allot(np.zeros(pixels), rays) <= rays).all()
    assert (allot(np.ones(pixels), rays) == rays).all()


def test_alike_pixels_have_all_as_many_rays_as_the_picture_holds():
    """What is allotted fits the list of groups, however a program rounds; beyond it pixels would be black."""
    wall = patch("wall", front_camera(), (-60, -60, 90, 90), 0.5, (0.8, 0.8, 0.8))
    np.testing.assert_allclose(uneven(layers_of(wall)), 0.8, rtol=1e-5)


@pytest.mark.parametrize("rays", [16, 64, 128])
def test_what_dark_pixels_get_at_least_is_taken_from_the_others(rays: int):
    random = np.random.default_rng(0)
    variance, light = 10.0 ** random.uniform(-6, 0, 50_000), random.uniform(0, 1, 50_000) ** 3
    least = jax.jit(least_through, static_argnums=1)(light, rays)
    counts = allot(variance, rays, least=least)
    assert (counts >= least).all()
    # Observed: 0 to 0.003 % less.
    assert 0.999 * rays <= counts.mean() <= rays


@eqx.filter_jit
def of_squares(layers: Layers) -> jax.Array:
    return contrast(layers, layers.lens, disparity_ranges(layers, layers.lens), "box")


def contrasts(layers: Layers) -> np.ndarray:
    found = np.asarray(of_squares(layers))
    squares = found.reshape(-(-layers.camera.height // EDGE), -1)
    return squares.repeat(EDGE, axis=0).repeat(EDGE, axis=1)


def test_contrast_is_the_variance_over_what_a_pixel_can_meet():
    """A bright half beside a dark one, both in the focal plane: only pixels along the edge see both."""
    camera = front_camera()
    dark = patch("dark", camera, (-20, -20, 15, 50), 0.5, (0.0, 0.0, 0.0))
    bright = patch("bright", camera, (15, -20, 60, 50), 0.5, (1.0, 0.0, 0.0))
    seen = contrasts(layers_of(dark, bright))
    assert (seen[:, 14:18].max(axis=0) > 0.1).any()
    assert seen.max() <= 0.25 + 1e-6
    # Means reach up to a pixel's square and its neighbours farther than rays do.
    assert not seen[:, :11].any()
    assert not seen[:, 21:].any()


def test_a_pane_before_a_plain_wall_gets_rays():
    """Nothing differs in what the lens centre sees of it, but every ray brings the one or the other."""
    camera = front_camera()
    wall = patch("wall", camera, (-20, -20, 60, 60), 0.4, (0.2, 0.2, 0.2))
    plain = patch("pane", camera, (8, 6, 24, 18), 0.5, (1.0, 1.0, 1.0))
    glass = dataclasses.replace(plain.materials[0], opacity=0.5)
    pane = dataclasses.replace(plain, materials=(glass,))
    seen = contrasts(peel(make_scene([wall, pane], unlit=True), camera, wide_lens(camera), supersampling=2))
    # Half the rays bring 1, half 0.2, in three channels.
    assert seen[12, 16] == pytest.approx(3 * 0.16, rel=0.02)
    assert seen[1, 1] == pytest.approx(0.0, abs=1e-6)


def test_highlights_count_relative_to_their_own_brightness():
    bulb = patch("bulb", front_camera(), (13, 9, 18, 14), 0.5, (1.0, 1.0, 1.0))
    dim, bright = (
        contrasts(
            eqx.tree_at(
                lambda a: (a.samples.radiance, a.background),
                layers,
                (layers.samples.radiance * scale, layers.background * scale),
            )
        )
        for layers in [layers_of(bulb)]
        for scale in (1.0, 1000.0)
    )
    # Observed: 3600 times; a million times if they counted as they are.
    assert bright.max() < 10_000 * dim.max()


def test_even_and_uneven_pictures_are_of_one_thing():
    """The same mean, and where much is plain the uneven one is nearer to the truth for the same rays."""
    layers = small_layers()

    def even(seed: int) -> np.ndarray:
        return np.asarray(render(layers, layers.lens, rays=16, even=True, smooth=False, seed=seed))

    # All that differs from the pictures below is noise, and of that an eighth.
    truth = np.mean([even(100 + k) for k in range(64)], axis=0)
    errors = []
    for picture in (uneven, lambda _, seed: even(seed)):
        pictures = [picture(layers, seed=k) for k in range(4)]
        errors.append(np.mean([(picture - truth) ** 2 for picture in pictures]))
        assert np.mean(pictures) == pytest.approx(truth.mean(), rel=2e-3)
    # Observed: 0.55.
    assert errors[0] < 0.8 * errors[1]


@pytest.mark.parametrize("most", [2000, 5000])
def test_groups_hold_every_ray_once(most: int):
    random = np.random.default_rng(3)
    width, height = 37, 21
    rays = 4 * random.choice([0, 1, 2, 4, 8], width * height)
    groups = eqx.filter_jit(groups_of)(
        jnp.asarray(rays, dtype=jnp.int32), width, height, 4, most=most, nested=4
    )
    assert int(groups.used) == min(rays.sum() // 4, most)
    # In two parts, of which the second begins within a pixel's groups.
    some = eqx.filter_jit(type(groups).some)
    parts = [some(groups, jnp.int32(begin), count) for begin, count in ((0, 777), (777, most - 777))]
    pixel, first, share = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("pixel", "first", "share")
    )
    used = pixel < width * height
    assert used.sum() == int(groups.used)
    counts = np.bincount(pixel[used], minlength=width * height)
    whole = np.flatnonzero(4 * counts == rays)
    # All of the list, or but for the pixels at its end.
    assert len(whole) >= (width * height if most > rays.sum() // 4 else 0.3 * width * height)
    for number in whole[::17]:
        mine = np.sort(first[used][pixel[used] == number])
        np.testing.assert_array_equal(mine, max(rays[number] - 4, 0) + 4 * np.arange(len(mine)))
    np.testing.assert_allclose(4 * share[used][rays[pixel[used]] > 0] * rays[pixel[used]], 4.0)


def test_even_groups_hold_every_ray_once():
    camera = front_camera(width=19, height=18)

    @jax.jit
    def all_groups():
        counts = even_counts(camera, 12)
        groups = counts.groups(counts.of_pixel, 19, 18)
        return groups.some(jnp.int32(0), groups.length)

    some = all_groups()
    pixel, first = np.asarray(some.pixel), np.asarray(some.first)
    used = pixel < 19 * 18
    pairs = pixel[used] * 3 + first[used] // 4
    np.testing.assert_array_equal(np.sort(pairs), np.arange(19 * 18 * 3))


def test_the_tiled_order_holds_every_pixel_once():
    order = np.asarray(tiled_pixels(50, 33))
    np.testing.assert_array_equal(np.sort(order[order < 50 * 33]), np.arange(50 * 33))


@pytest.mark.parametrize("length", [1, 128, 1000, 70000])
def test_prefix_sums_and_compaction(length: int):
    values = np.random.default_rng(length).integers(0, 5, length).astype(np.int32)
    before, total = jax.jit(prefix_sums)(values)
    np.testing.assert_array_equal(before, np.cumsum(values) - values)
    assert int(total) == values.sum()
    np.testing.assert_array_equal(jax.jit(running_max)(values), np.maximum.accumulate(values))
    places, count = jax.jit(compacted)(values == 3)
    np.testing.assert_array_equal(np.asarray(places)[: int(count)], np.flatnonzero(values == 3))


def test_a_constant_background_is_seen_as_it_is():
    layers = layers_of(patch("far", front_camera(), (0, 0, 1, 1), 0.1), background=0.3)
    np.testing.assert_allclose(uneven(layers)[12, 16], 0.3, rtol=1e-5)
