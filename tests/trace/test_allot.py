"""Rays go where what they meet differs; blocks hold every part of every pixel once."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, wide_lens

from focusjax.layers import peel
from focusjax.scene import constant_background, make_scene
from focusjax.trace import render
from focusjax.trace._allot import FEWEST, allot, counts_for
from focusjax.trace._blocks import Blocks
from focusjax.trace._tracer import Tracer


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


def test_a_picture_without_contrast_takes_the_fewest_that_make_the_mean():
    assert (allot(np.zeros(100), 64) <= 64).all()
    assert (allot(np.ones(100), 64) == 64).all()


def contrasts(layers):
    tracer = Tracer(layers, layers.lens)
    return tracer.contrast.reshape(layers.camera.height, layers.camera.width)


def test_contrast_is_the_variance_over_what_a_pixel_can_meet():
    """A bright half beside a dark one, both in the focal plane: only pixels along the edge see both."""
    camera = front_camera()
    lens = wide_lens(camera)
    halves = [
        patch("dark", camera, (-20, -20, 16, 50), 0.5, (0.0, 0.0, 0.0)),
        patch("bright", camera, (16, -20, 60, 50), 0.5, (1.0, 0.0, 0.0)),
    ]
    seen = contrasts(peel(make_scene(halves, unlit=True), camera, lens))
    assert (seen[:, 14:18].max(axis=0) > 0.1).any()
    assert seen.max() <= 0.25 + 1e-6
    assert not seen[:, :13].any()
    assert not seen[:, 19:].any()


def test_a_pane_before_a_plain_wall_gets_rays():
    """Nothing differs in what the lens centre sees of it, but every ray brings the one or the other."""
    camera = front_camera()
    wall = patch("wall", camera, (-20, -20, 60, 60), 0.4, (0.2, 0.2, 0.2))
    plain = patch("pane", camera, (8, 6, 24, 18), 0.5, (1.0, 1.0, 1.0))
    glass = dataclasses.replace(plain.materials[0], opacity=0.5)
    pane = dataclasses.replace(plain, materials=(glass,))
    seen = contrasts(peel(make_scene([wall, pane], unlit=True), camera, wide_lens(camera)))
    # Half the rays bring 1, half 0.2, in three channels.
    assert seen[12, 16] == pytest.approx(3 * 0.16, rel=0.02)
    assert seen[1, 1] == pytest.approx(0.0, abs=1e-6)


def test_highlights_count_relative_to_their_own_brightness():
    camera = front_camera()
    bulb = patch("bulb", camera, (14, 10, 18, 14), 0.5, (1.0, 1.0, 1.0))
    dim, bright = (
        contrasts(
            eqx.tree_at(
                lambda a: (a.samples.radiance, a.background),
                layers,
                (layers.samples.radiance * scale, layers.background * scale),
            )
        )
        for layers in [peel(make_scene([bulb], unlit=True), camera, wide_lens(camera))]
        for scale in (1.0, 1000.0)
    )
    assert bright.max() < 200 * dim.max()


def test_even_and_uneven_pictures_are_of_one_thing():
    """The same mean, and where much is plain the uneven one is nearer to the truth for the same rays."""
    camera = front_camera()
    wall = patch("wall", camera, (-60, -60, 90, 90), 0.4, (0.2, 0.5, 0.2))
    square = patch("square", camera, (11, 7, 19, 15), 0.9, (1.0, 1.0, 1.0))
    lens = wide_lens(camera, focus=0.4)
    layers = peel(make_scene([wall, square], unlit=True), camera, lens)
    truth = np.asarray(render(layers, layers.lens, rays=1024, even=True, seed=7))
    errors = {}
    for even in (True, False):
        pictures = [
            np.asarray(render(layers, layers.lens, rays=16, even=even, smooth=False, seed=k))
            for k in range(4)
        ]
        errors[even] = np.mean([(picture - truth) ** 2 for picture in pictures])
        assert np.mean(pictures) == pytest.approx(truth.mean(), rel=2e-3)
    # Observed: 0.47.
    assert errors[False] < 0.8 * errors[True]


def test_blocks_hold_every_part_once():
    random = np.random.default_rng(3)
    parts, depth = random.integers(1, 9, 300), random.integers(0, 12, 300)
    made = Blocks(parts, depth, 12, 20, 64)
    blocks = [made[number] for number in range(len(made))]
    done = [
        (pixel, part)
        for block in blocks
        for pixel, part, place in zip(block.pixels, block.part, block.place, strict=True)
        if place < len(block.places)
    ]
    assert sorted(done) == [(pixel, part) for pixel in range(300) for part in range(parts[pixel])]
    for block in blocks:
        assert len(block.pixels) == len(block.part) == 64
        assert (depth[block.pixels] <= block.depth).all()
    total = np.zeros((300, 1))
    for block in blocks:
        brought = np.bincount(block.place, minlength=65)[: len(block.places)]
        total[block.places] += brought[:, None]
    np.testing.assert_array_equal(total[:, 0], parts)


def test_blocks_know_only_pixels_with_rays():
    parts = np.zeros(4000, dtype=int)
    parts[np.random.default_rng(4).random(4000) < 0.02] = 3
    made = Blocks(parts, np.zeros(4000, dtype=int), 4, 80, 64)
    total = np.zeros(4000, dtype=int)
    for number in range(len(made)):
        block = made[number]
        assert len(block.places) <= 64
        total[block.places] += np.bincount(block.place, minlength=65)[: len(block.places)]
    np.testing.assert_array_equal(total, parts)


def test_a_constant_background_is_seen_as_it_is():
    camera = front_camera()
    layers = peel(
        make_scene(
            [patch("far", camera, (0, 0, 1, 1), 0.1)], background=constant_background(0.3), unlit=True
        ),
        camera,
        wide_lens(camera),
    )
    assert jnp.allclose(render(layers, layers.lens, rays=4)[12, 16], 0.3)
