"""Derivatives of pictures through real glass, against differences of converged pictures."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import biconvex
from small_scenes import varied_scene

from focusjax.geometry import look_at
from focusjax.layers import Layers, peel
from focusjax.lens import PrescriptionLens, focused_lens, prescription_lens
from focusjax.trace import render, render_differentiable

CAMERA = look_at((0, 0, 0), (0, 0, -1), width=32, height=24, focal_length=1.25, sensor_width=1.0)
"""The front camera of other tests, with a lens so large that it blurs as much as theirs."""
STEPS = np.array([0.02, 0.04])


@eqx.filter_jit
def lens_at(values: jax.Array, lens: PrescriptionLens) -> PrescriptionLens:
    """Of given focus in 1/m, with rims whose radii are a factor of exp(values[1]) larger."""
    rims = lens.prescription.semi_diameters * jnp.exp(values[1])
    return focused_lens(dataclasses.replace(lens.prescription, semi_diameters=rims), CAMERA, values[0])


@eqx.filter_jit
def jacobian(layers: Layers, values: jax.Array, lens: PrescriptionLens) -> jax.Array:
    """By the two values [h, w, 3, 2]."""

    def picture(values: jax.Array) -> jax.Array:
        return render_differentiable(layers, lens_at(values, lens), rays=128, derivative_rays=128)

    return jax.jacfwd(picture)(values)


def blocks(picture: np.ndarray) -> np.ndarray:
    """Means over 4 x 4 pixels."""
    return picture.reshape(6, 4, 8, 4, -1).mean(axis=(1, 3))


@pytest.fixture(scope="module")
def both() -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of means over blocks by the two values, and differences of converged pictures."""
    lens = prescription_lens(biconvex(), CAMERA, focus_distance=2.0, f_number=5)
    at = np.array([0.5, 0.0])
    layers = peel(varied_scene(), CAMERA, lens_at(jnp.asarray(at + [0.05, 0.1]), lens))
    truth = []
    for k in range(2):
        ends = [
            render(layers, lens_at(jnp.asarray(at + side * STEPS * np.eye(2)[k]), lens), rays=1024, even=True)
            for side in (1, -1)
        ]
        truth.append((np.asarray(ends[0]) - np.asarray(ends[1])) / (2 * STEPS[k]))
    found = np.asarray(jacobian(layers, jnp.asarray(at), lens))
    return np.stack([blocks(found[..., k]) for k in range(2)]), np.stack([blocks(t) for t in truth])


@pytest.mark.parametrize("number", [0, 1], ids=["focus", "opening"])
def test_glass_moves_silhouettes(both, number: int):
    found, truth = (each[number] for each in both)
    print(
        "OBS",
        (found * truth).sum() / (truth * truth).sum(),
        np.linalg.norm(found - truth) / np.linalg.norm(truth),
    )
    assert abs((found * truth).sum() / (truth * truth).sum() - 1.0) < 0.05
    assert np.linalg.norm(found - truth) < 0.25 * np.linalg.norm(truth)
