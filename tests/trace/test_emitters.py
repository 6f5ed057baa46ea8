"""Rays drawn for emitters bring what plain rays would, with less noise, and no more light."""

import dataclasses
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_layers, wide_lens

from focusjax.layers import Layers, peel
from focusjax.lens import AbstractLens, ThinLens, TiltShiftLens, polygon
from focusjax.scene import constant_background, make_scene
from focusjax.trace import _emitters, render
from focusjax.trace._emitters import split_emitters
from focusjax.trace._picture import picture
from focusjax.trace._render import render_settings

CAMERA = front_camera(48, 36)
LENS = TiltShiftLens(
    jnp.array([0.6, 0.3, 1.0]), jnp.array(14.0 / float(CAMERA.focal_px)), polygon(5, rotation=0.3)
)
"""Its rays are no affine function of the aperture's points."""


def plain_picture(layers: Layers, lens: AbstractLens, rays: int, seed: int) -> np.ndarray:
    """By plain rays only."""
    settings = dataclasses.replace(render_settings(layers, lens, rays=rays, even=True), emitters=False)
    return np.asarray(picture(layers, lens, jnp.uint32(seed), settings=settings))


@cache
def lit() -> Layers:
    """Lamps before a wall, one of them leaning, behind bars and a pane."""
    lamps = [
        patch("square", CAMERA, (10, 9, 12, 11), 0.4, (60, 40, 20)),
        patch("leaning", CAMERA, (31, 20, 34, 22), (0.42, 0.55, 0.55, 0.42), (20, 30, 40)),
        patch("dot", CAMERA, (20, 26, 21, 27), 1.6, (99, 99, 99)),
    ]
    wall = patch("wall", CAMERA, (-60, -60, 90, 90), 0.25, (0.2, 0.3, 0.2))
    bars = [patch(f"bar {x}", CAMERA, (x, -30, x + 3, 80), 0.9, (0.1, 0.1, 0.1)) for x in (5, 20, 34)]
    plain = patch("pane", CAMERA, (14, 3, 46, 27), 0.8, (0.5, 0.1, 0.1))
    pane = dataclasses.replace(plain, materials=(dataclasses.replace(plain.materials[0], opacity=0.5),))
    return peel(make_scene([*lamps, wall, *bars, pane], unlit=True), CAMERA, LENS, supersampling=1)


def lamp_layers(
    lens: AbstractLens, *boxes: tuple[float, ...], disparity: float = 0.2, camera=CAMERA, radiance=80.0
) -> Layers:
    """Lamps in the dark."""
    lamps = [patch(f"lamp {k}", camera, box, disparity, radiance) for k, box in enumerate(boxes)]
    scene = make_scene(lamps, background=constant_background(0.0), unlit=True)
    return peel(scene, camera, lens, supersampling=2)


def test_they_bring_what_plain_rays_would():
    emitted = np.stack([np.asarray(render(lit(), LENS, rays=64, even=True, seed=k)) for k in range(4)])
    others = np.stack([plain_picture(lit(), LENS, 256, k) for k in range(4)])

    def blocks(pictures: np.ndarray) -> np.ndarray:
        return pictures.reshape(4, 6, 6, 8, 6, 3).mean(axis=(2, 4))

    first, second = blocks(emitted), blocks(others)
    noise = np.sqrt((first.var(axis=0, ddof=1) + second.var(axis=0, ddof=1)).mean() / 4)
    away = first.mean(axis=0) - second.mean(axis=0)
    print(np.sqrt((away**2).mean()) / noise, first.mean() / second.mean())
    print(emitted.std(axis=0).mean() / others.std(axis=0).mean())
    np.save("/tmp/emit_a.npy", emitted), np.save("/tmp/emit_b.npy", others)
    assert np.sqrt((away**2).mean()) < 1.5 * noise
    assert first.mean() == pytest.approx(second.mean(), rel=0.01)
    assert emitted.std(axis=0).mean() < 0.7 * others.std(axis=0).mean()
