"""Derivatives where something is closed, in focus, thin, touching, seen through, cornered or glaring."""

import dataclasses
import math
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, wide_lens

from focusjax.layers import Layers, peel
from focusjax.lens import Polygon, ThinLens
from focusjax.scene import Scene, SceneObject, constant_background, make_scene
from focusjax.trace import render

RAYS = 64
CAMERA = front_camera(16, 12)
WIDEST = wide_lens(CAMERA, focus=0.0)
PARALLAX = 11.0
GLARE = 1e5
OBJECTS = 8
EDGE, STOPPED = 7.3, 0.6


def scene_of(*objects: SceneObject, background: float = 0.2) -> Scene:
    """As many objects in any scene, so that scenes share compiled programs."""
    unseen = [pane(f"unseen {k}", (900, 900, 901, 901), 0.5) for k in range(OBJECTS - len(objects))]
    return make_scene([*objects, *unseen], background=constant_background(background), unlit=True)


def pane(name: str, box: tuple[float, ...], *look: float, stopped: float = 0.5) -> SceneObject:
    """A patch of given disparity and radiance that stops a share of the rays."""
    plain = patch(name, CAMERA, box, *look)
    return dataclasses.replace(plain, materials=(dataclasses.replace(plain.materials[0], opacity=stopped),))


def hard_scene() -> Scene:
    """Bars a pixel wide, two surfaces that touch, one a hair before them, a pane, and lamps, near and far."""
    boxes = {
        "bar": ((5.27, -60, 6.27, 80), 1.0, 0.6),
        "level bar": ((-60, 7.13, 80, 8.13), 0.9, 0.8),
        "left": ((-60, -60, 9.37, 80), 0.3, 0.9),
        "right": ((9.37, -60, 80, 80), 0.3, 0.1),
        "hair": ((8.19, 2.21, 12.43, 5.77), 0.3 + 1e-6, 0.5),
        "near lamp": ((12.31, 8.57, 13.31, 9.57), 1.0, GLARE),
        "far lamp": ((2.11, 2.39, 3.11, 3.39), 0.31, GLARE),
    }
    seen_through = pane("pane", (9.73, -60, 11.91, 80), 0.8, 0.4)
    return scene_of(seen_through, *(patch(name, CAMERA, *values) for name, values in boxes.items()))


@cache
def layers_of(case: str) -> Layers:
    """All cases have layers of one shape, which share compiled programs."""
    if case == "hard":
        return peel(hard_scene(), CAMERA, WIDEST, supersampling=1, max_layers=5)
    boxes = {0.9: (-60, -60, 7.37, 80), 0.1: (7.37, -60, 80, 80)}
    sharp = [patch(str(look), CAMERA, box, 0.5, look) for look, box in boxes.items()]
    scene = {
        "in focus": lambda: scene_of(*sharp),
        "empty": scene_of,
        "edge": lambda: scene_of(
            pane("light", (-200, -200, EDGE, 200), 1.0, 1.0, stopped=STOPPED), background=0.0
        ),
    }[case]()
    hard = layers_of("hard")
    found = peel(scene, CAMERA, WIDEST, supersampling=1, max_layers=5, like=hard)
    if found.samples.opacity is not None:
        return found
    solid = jnp.ones_like(hard.samples.opacity)
    return eqx.tree_at(lambda each: each.samples.opacity, found, solid, is_leaf=lambda leaf: leaf is None)


def lens_of(values: jax.Array, layers: Layers) -> ThinLens:
    """From focus in 1/m, pixels that the rim moves per dioptre, and how the blades are turned and bent."""
    radius = values[1] / layers.camera.focal_px
    return ThinLens(values[0], radius, Polygon(rotation=values[2], roundness=values[3], blades=5))


def picture_of(layers: Layers, values: jax.Array) -> jax.Array:
    return render(layers, lens_of(values, layers), even=True, rays=RAYS, derivative_rays=RAYS)


picture_alone = eqx.filter_jit(picture_of)


@eqx.filter_jit
def jacobian(layers: Layers, values: jax.Array) -> jax.Array:
    """By the four values [h, w, 3, 4]."""
    return jax.jacfwd(lambda values: picture_of(layers, values))(values)


@cache
def derivatives(case: str, values: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The picture and its Jacobian."""
    at = layers_of(case), jnp.array(values)
    return np.asarray(picture_alone(*at)), np.asarray(jacobian(*at))


CORNERED, ROUND = (0.4, 0.0), (0.4, 1.0)
LENSES = {
    "before all": ("hard", (0.2, PARALLAX, *ROUND)),
    "closed": ("hard", (0.5, 0.0, *ROUND)),
    "in focus": ("in focus", (0.5, PARALLAX, *CORNERED)),
    "empty": ("empty", (0.5, PARALLAX, *CORNERED)),
}


@pytest.mark.slow
def test_a_closed_opening_changes_nothing():
    """Openings of either sign make one picture, so that its derivative by a closed one is 0.

    Rays to opposite sides cancel but for noise.
    """
    _, jacobian = derivatives(*LENSES["closed"])
    np.testing.assert_array_equal(jacobian[..., 0], 0.0)
    # Observed: 0.013 of the glare.
    assert np.abs(jacobian[..., 1:]).max() < 0.02 * GLARE


@pytest.mark.slow
def test_what_is_in_focus_changes_nothing_by_the_opening():
    """Rays of a film point meet in one point whatever the opening, and as focus moves the edge only blurs."""
    _, jacobian = derivatives(*LENSES["in focus"])
    # Beside the edge colour changes across samples, and rays at their borders may meet either.
    # Observed: 0.024 there, along three columns of 16; 2e-18 elsewhere.
    off = np.abs(jacobian[..., 1:])
    assert np.quantile(off, 0.75) < 1e-12
    assert off.max() < 0.05


def test_an_empty_picture_changes_nothing():
    value, jacobian = derivatives(*LENSES["empty"])
    np.testing.assert_allclose(value, 0.2, rtol=1e-12)
    np.testing.assert_allclose(jacobian, 0.0, rtol=0, atol=1e-12)


def test_glare_is_moved_and_neither_lost_nor_made():
    """As lamps blur over more of the frame, their light stays the same but for what crosses its border."""
    value, jacobian = derivatives(*LENSES["before all"])
    assert value.max() > 100
    gained = jacobian[..., 0].sum(axis=(0, 1)) / np.abs(jacobian[..., 0]).sum(axis=(0, 1))
    # Observed: 0.015.
    assert np.abs(gained).max() < 0.06


def test_what_is_seen_through_moves_as_much_as_it_stops():
    """Light that stops 0.6 of the rays, before darkness, by the formula for a straight edge times 0.6.

    A disk of radius c around x is lit by the share F((x - 7.3) / c) with F' = -2 sqrt(1 - t^2) / pi.
    """
    values = jnp.array([0.5, PARALLAX, *ROUND])
    found = np.asarray(jacobian(layers_of("edge"), values))[..., 0, :2].mean(axis=0)
    radius = 0.5 * PARALLAX
    t = np.clip((np.linspace(0, 16, 16 * 64 + 1) - EDGE) / radius, -1, 1)
    by_radius = 2 / math.pi * np.sqrt(1 - t**2) * t / radius
    by_radius = STOPPED * ((by_radius[1:] + by_radius[:-1]) / 2).reshape(16, 64).mean(axis=1)
    by_settings = by_radius[:, None] * np.array([-PARALLAX, 0.5])
    projection = np.sum(found * by_settings, axis=0) / np.sum(by_settings**2, axis=0)
    # Observed: 0.989 by focus and 1.031 by the opening, as which rays stop is chance.
    np.testing.assert_allclose(projection, 1.0, atol=0.12)
