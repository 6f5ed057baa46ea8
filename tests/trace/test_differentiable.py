"""Derivatives of the picture: against closed forms, differences of converged pictures, and each other."""

import math
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_layers, wide_lens

from focusjax.layers import Layers, peel
from focusjax.lens import ThinLens
from focusjax.scene import constant_background, make_scene
from focusjax.trace import render

PARALLAX = 12.0


def thin(values, like: ThinLens) -> ThinLens:
    """A lens of given focus and pixels per dioptre."""
    radius = values[1] / 40.0
    return eqx.tree_at(
        lambda lens: (lens.focus_disparity, lens.aperture_radius),
        like,
        (jnp.asarray(values[0]), jnp.asarray(radius)),
    )


@eqx.filter_jit
def both_modes(layers, lens, values, rays, seed):
    """The picture, its Jacobian [h, w, 3, 2] by focus and opening, and the gradient of a weighted sum."""

    def picture(values):
        return render(layers, thin(values, lens), even=True, rays=rays, derivative_rays=rays, seed=seed)

    def along(change):
        return jax.jvp(picture, (values,), (change,))

    value, jacobian = jax.vmap(along, out_axes=(None, -1))(jnp.eye(2))
    random = jax.random.normal(jax.random.key(0), value.shape, dtype=value.dtype)
    return value, jacobian, jax.grad(lambda values: (random * picture(values)).sum())(values), random


@cache
def derivatives(rays: int = 256, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Of the varied scene, through a lens a little inside the one it was peeled for."""
    layers = varied_layers()
    found = both_modes(layers, layers.lens, jnp.array([0.47, 0.9 * PARALLAX]), rays, jnp.uint32(seed))
    return tuple(np.asarray(part) for part in found)


def blocks(picture: np.ndarray) -> np.ndarray:
    """Means over 4 x 4 pixels."""
    height, width = picture.shape[:2]
    return picture.reshape(height // 4, 4, width // 4, 4, *picture.shape[2:]).mean(axis=(1, 3))


def test_the_picture_is_that_of_render():
    lens = thin((0.47, 0.9 * PARALLAX), wide_lens(front_camera()))
    expected = render(varied_layers(), lens, rays=256, even=True)
    # Observed: 2e-16.
    np.testing.assert_allclose(derivatives()[0], expected, rtol=0, atol=1e-14)


def test_forward_and_reverse_agree():
    _, jacobian, gradient, weights = derivatives()
    forward = np.einsum("hwc,hwck->k", weights, jacobian)
    # Observed: 2e-15 relative.
    np.testing.assert_allclose(gradient, forward, rtol=1e-12)


@pytest.mark.parametrize(("number", "step"), [(0, 0.02), (1, 0.3)], ids=["focus", "opening"])
def test_differences_of_the_converged_picture(number: int, step: float):
    """A ball on the border, a bar before everything, a steep floor: silhouettes in the blur everywhere."""
    values = np.array([0.47, 0.9 * PARALLAX])
    ends = []
    for sign in (1, -1):
        moved = values.copy()
        moved[number] += sign * step
        ends.append(
            np.asarray(render(varied_layers(), thin(moved, wide_lens(front_camera())), rays=2048, even=True))
        )
    truth = (ends[0] - ends[1]) / (2 * step)
    found = derivatives()[1][..., number]
    found, truth = blocks(found), blocks(truth)
    # Observed: 1.000 and 0.054 by focus, 1.029 and 0.151 by opening; the noise of the differences is in them.
    assert abs((found * truth).sum() / (truth * truth).sum() - 1.0) < 0.05
    assert np.linalg.norm(found - truth) < 0.25 * np.linalg.norm(truth)


def test_noise_of_the_picture_is_not_that_of_its_derivatives():
    """Gradients of losses multiply both. By the opening a mean of the picture's rays is a part of both."""
    one, other = derivatives(), derivatives(seed=1)
    noise, of_derivatives = one[0] - other[0], one[1][..., 1] - other[1][..., 1]
    # Observed: 0.15, and at most 0.3 of any two of six seeds; -2.0 if both are made of the same rays.
    assert abs(0.9 * PARALLAX * (noise * of_derivatives).sum() / (noise**2).sum()) < 0.5


@cache
def edge_layers() -> tuple[Layers, ThinLens]:
    """Light left of x = 15.3 at disparity 1, darkness behind."""
    camera = front_camera()
    scene = make_scene(
        [patch("light", camera, (-200, -200, 15.3, 200), 1.0)],
        background=constant_background(0.0),
        unlit=True,
    )
    lens = wide_lens(camera)
    # Layers of one shape share a compiled program.
    return peel(scene, camera, lens, supersampling=2, like=varied_layers()), lens


def edge_by_radius(radius: float) -> np.ndarray:
    """The derivative [w] of what the edge lights by the radius of its blur."""
    t = np.clip((np.linspace(0, 32, 32 * 64 + 1) - 15.3) / radius, -1, 1)
    by_radius = 2 / math.pi * np.sqrt(1 - t**2) * t / radius
    return ((by_radius[1:] + by_radius[:-1]) / 2).reshape(32, 64).mean(axis=1)


def test_a_straight_edge_by_formula():
    """A disk of radius c around x is lit by the share F((x - 15.3) / c) with F' = -2 sqrt(1 - t^2) / pi."""
    layers, lens = edge_layers()
    focus, opening = 0.5, 0.95 * PARALLAX
    _, jacobian, _, _ = both_modes(layers, lens, jnp.array([focus, opening]), 256, jnp.uint32(0))
    radius = opening * (1.0 - focus)
    by_radius = edge_by_radius(radius)
    for number, rate in ((0, -opening), (1, 1.0 - focus)):
        found = np.asarray(jacobian)[..., 0, number]
        scale = np.abs(rate * by_radius).max()
        # Observed: 0.026 and 0.031, the noise of 24 rows together.
        assert np.abs(found.mean(axis=0) - rate * by_radius).max() < 0.08 * scale
        # Where all is dark or all is light, nothing changes. Observed: 7e-17.
        away = np.abs(np.arange(32) + 0.5 - 15.3) > radius + 1
        assert np.abs(found[:, away]).max() < 1e-12 * scale


def test_a_pinhole_has_no_slope():
    """A picture is the same for openings of either sign: its derivative by a closed one is 0, and finite."""
    layers = varied_layers()
    value, jacobian, gradient, _ = both_modes(layers, layers.lens, jnp.array([0.47, 0.0]), 256, jnp.uint32(0))
    assert np.isfinite(value).all()
    assert np.isfinite(gradient).all()
    np.testing.assert_array_equal(jacobian[..., 0], 0.0)
    # Observed: 5.9e-3, what is left of rays to opposite sides of the opening.
    assert np.abs(jacobian[..., 1]).max() < 0.02


@pytest.mark.slow
def test_radiance_enters_linearly():
    """The derivative along the radiance itself is the picture, less what does not come from surfaces."""
    layers = varied_layers()
    lens = thin((0.47, 0.9 * PARALLAX), layers.lens)
    look = layers.samples.radiance, layers.background

    def picture(look):
        changed = eqx.tree_at(lambda layers: (layers.samples.radiance, layers.background), layers, look)
        return render(changed, lens, even=True, rays=16)

    @jax.jit
    def answers(look):
        value, along = jax.jvp(picture, (look,), (look,))
        (pulled,) = jax.vjp(picture, look)[1](jnp.ones_like(value))
        return value, along, sum((a * b).sum() for a, b in zip(pulled, look, strict=True))

    value, along, sum_ = answers(look)
    np.testing.assert_allclose(along, value, rtol=1e-12)
    np.testing.assert_allclose(sum_, value.sum(), rtol=1e-12)


def test_a_lens_beyond_the_layers_is_refused_in_compiled_functions_too():
    layers = varied_layers()
    with pytest.raises(ValueError, match="peel again"):
        render(layers, thin((0.47, 1.2 * PARALLAX), layers.lens), even=True, rays=1)
    with pytest.raises(ValueError, match="focus_disparity of the lens is nan"):
        render(layers, thin((np.nan, 0.5 * PARALLAX), layers.lens), even=True, rays=1)
    with pytest.raises(Exception, match="rays of the lens leave"):
        jax.block_until_ready(
            both_modes(layers, layers.lens, jnp.array([0.47, 1.2 * PARALLAX]), 256, jnp.uint32(0))
        )
