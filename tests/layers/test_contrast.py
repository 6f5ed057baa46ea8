"""Layers of one sample per pixel keep the contrast of fine detail in focus."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import at_pixels, front_camera

from focusjax.layers import Layers, peel
from focusjax.lens import ThinLens
from focusjax.scene import Scene, constant_background, make_object, make_scene
from focusjax.trace import render

PERIOD = 3.2
"""Pixels; ten fit the picture."""
DISPARITY = 0.5


@pytest.fixture(scope="module")
def waves() -> tuple[Scene, ThinLens]:
    """A wall whose radiance is a wave along x, in focus."""
    x = np.arange(-16.0, 48.0, 0.2)
    top, bottom = (np.stack([x, np.full_like(x, y)], axis=1) for y in (-20.0, 44.0))
    vertices = at_pixels(np.concatenate([top, bottom]), np.full(2 * len(x), DISPARITY), front_camera())
    k = np.arange(len(x) - 1)
    faces = np.concatenate(
        [np.stack([k, k + 1, k + len(x)], 1), np.stack([k + 1, k + len(x) + 1, k + len(x)], 1)]
    )
    colours = np.tile(0.5 + 0.4 * np.cos(2 * np.pi * x / PERIOD), 2)[:, None] * np.ones(3)
    wall = make_object("wall", vertices, faces, vertex_colours=colours)
    scene = make_scene([wall], background=constant_background(0.0), unlit=True)
    lens = ThinLens(jnp.array(DISPARITY), jnp.array(0.02))
    return scene, lens


def amplitude(layers: Layers, lens: ThinLens) -> float:
    """Of the wave in the picture, relative to that in the scene."""
    row = np.asarray(render(layers, lens, rays=64, even=True))[..., 1].mean(axis=0)
    phase = np.exp(-2j * np.pi * (np.arange(32) + 0.5) / PERIOD)
    return float(abs((row * phase).mean()) * 2 / 0.4)


@pytest.mark.parametrize("supersampling", [1, 2])
def test_fine_detail_keeps_its_contrast(waves: tuple[Scene, ThinLens], supersampling: int):
    scene, lens = waves
    layers = peel(scene, front_camera(), lens, supersampling=supersampling)
    # The mean over a pixel, and that the mesh is straight between vertices 0.2 pixels apart.
    expected = np.sinc(1 / PERIOD) * np.sinc(0.2 / PERIOD) ** 2
    # Observed: 6e-5 off.
    assert amplitude(layers, lens) == pytest.approx(expected, rel=5e-4)
