"""Derivatives of pictures through real glass, against differences of converged pictures."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import biconvex
from small_scenes import varied_scene

from focusjax.geometry import look_at
from focusjax.layers import Layers, peel
from focusjax.lens import PrescriptionLens, ThinLens, prescription_lens
from focusjax.trace import render

CAMERA = look_at((0, 0, 0), (0, 0, -1), width=16, height=12, focal_length=1.25, sensor_width=1.0)
"""The view of other tests, through a lens so large that it blurs as much as theirs."""


def moved(lens: PrescriptionLens, millimetres: jax.Array) -> PrescriptionLens:
    """With its film farther away, whose picture is larger and focused closer."""
    return eqx.tree_at(lambda each: each.film_place, lens, lens.film_place + millimetres)


@jax.jit
def along(layers: Layers, lens: PrescriptionLens) -> jax.Array:
    """The derivative [h, w, 3] of the picture by the place of the film."""

    def picture(millimetres: jax.Array) -> jax.Array:
        return render(layers, moved(lens, millimetres), even=True, rays=128, derivative_rays=128)

    return jax.jvp(picture, (jnp.zeros(()),), (jnp.ones(()),))[1]


def blocks(picture: np.ndarray) -> np.ndarray:
    """Means over 4 x 4 pixels."""
    return picture.reshape(3, 4, 4, 4, 3).mean(axis=(1, 3))


@pytest.mark.slow
def test_silhouettes_move_as_the_film_does():
    lens = prescription_lens(biconvex(), CAMERA, focus_distance=2.0, f_number=4)
    layers = peel(varied_scene(), CAMERA, ThinLens(lens.focus_disparity, jnp.asarray(0.2)), supersampling=2)
    step = 60.0
    ends = [
        np.asarray(render(layers, moved(lens, jnp.asarray(side * step)), rays=2048, even=True))
        for side in (1, -1)
    ]
    found, truth = blocks(np.asarray(along(layers, lens))), blocks((ends[0] - ends[1]) / (2 * step))
    projection = (found * truth).sum() / (truth * truth).sum()
    error = np.linalg.norm(found - truth) / np.linalg.norm(truth)
    # Observed: 1.007 and 0.044, the noise of the differences among it.
    assert abs(projection - 1.0) < 0.02
    assert error < 0.1
