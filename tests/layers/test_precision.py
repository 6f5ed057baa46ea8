"""Layers are made in the precision that holds where they are asked for, whichever threads make them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, wide_lens

from focusjax import _parallel
from focusjax.layers import peel
from focusjax.scene import constant_background, make_scene


@pytest.mark.parametrize("double", [True, False])
def test_a_precision_that_holds_for_a_while_is_that_of_the_layers(double: bool, monkeypatch):
    monkeypatch.setattr(_parallel, "CORES", 2)
    with jax.enable_x64(double):
        camera = front_camera(16, 12)
        near = patch("near", camera, (4, 3, 9, 8), 0.5, 0.7)
        scene = make_scene([near], background=constant_background(0.2), unlit=True)
    # The precision of this thread is not that of others, which have the one of the whole process.
    with jax.enable_x64(not double):
        threads = _parallel.in_parallel(lambda _: jnp.zeros(()).dtype.itemsize, range(4))
    with jax.enable_x64(double):
        layers = peel(scene, camera, wide_lens(camera), supersampling=1)
    real = [leaf.dtype for leaf in jax.tree.leaves(layers) if eqx.is_inexact_array(leaf)]
    assert threads == [4 if double else 8] * 4
    assert set(real) == {np.dtype(np.float64 if double else np.float32)}
