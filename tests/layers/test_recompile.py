"""Peeling a deformed scene again compiles nothing: shapes follow the grid and the mesh, not what is seen."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from glossy import glossy_lens, glossy_scene
from small_scenes import front_camera, patch, varied_layers, varied_scene

from focusjax.layers import Layers, peel
from focusjax.scene import Scene, make_scene
from focusjax.trace import render

CAMERA = front_camera(56, 44)
"""Of a size that no other test compiles for."""
FLAT = patch("flat", front_camera(), (-20, -20, 60, 60), 0.5)


def rippled(scene: Scene, phase: float) -> Scene:
    """The same faces, every vertex moved by up to 4 mm."""
    waves = np.sin(scene.vertices * [31.0, 17.0, 23.0] + phase)
    return dataclasses.replace(scene, vertices=scene.vertices + 0.004 * waves)


def peeled(phase: float, *, view_dependent: bool, like: Layers | None = None) -> Layers:
    scene = rippled(glossy_scene(), phase)
    return peel(scene, CAMERA, glossy_lens(), supersampling=2, view_dependent=view_dependent, like=like)


@pytest.mark.parametrize("view_dependent", [False, True])
def test_a_deformed_scene_compiles_nothing(view_dependent: bool):
    with compilations() as compiled:
        jax.jit(lambda x: x + 42.5)(jnp.zeros(3))
        assert compiled, "compilations are not reported under the expected name"
        before = peeled(0.0, view_dependent=view_dependent)
        render(before, before.lens, rays=4)
        compiled.clear()
        after = peeled(1.0, view_dependent=view_dependent, like=before)
        assert not compiled
        render(after, after.lens, rays=4)
        assert not compiled
    # Other surfaces, fewer of them, and a margin that would have been narrower.
    assert after.samples_kept != before.samples_kept
    assert peeled(1.0, view_dependent=view_dependent).grid.margin < before.grid.margin == after.grid.margin


def test_what_is_kept_for_the_shape_changes_nothing():
    layers = varied_layers()
    lens, camera = layers.lens, layers.camera
    few = peel(varied_scene(), camera, lens, supersampling=2, max_layers=2)
    wide = dataclasses.replace(layers, grid=dataclasses.replace(layers.grid, margin=48))
    again = peel(varied_scene(), camera, lens, supersampling=2, like=wide)
    assert (again.count, again.grid.margin) == (layers.count, 48)
    deeper = peel(make_scene([FLAT], unlit=True), camera, lens, supersampling=2, like=layers)
    assert deeper.count == layers.count > 1
    assert not np.asarray(deeper.disparity[1:]).any()
    assert peel(varied_scene(), camera, lens, supersampling=2, like=few).count == layers.count
    pictures = [np.asarray(render(one, lens, rays=8, even=True)) for one in (layers, again)]
    # Observed: 1e-15.
    np.testing.assert_allclose(*pictures, atol=1e-9)


def test_layers_of_another_frame_are_refused():
    layers = varied_layers()
    with pytest.raises(
        ValueError, match="are of 32 x 24 pixels at a supersampling of 2; expected 32 x 24 at 1"
    ):
        peel(varied_scene(), layers.camera, layers.lens, supersampling=1, like=layers)
