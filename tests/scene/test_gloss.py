"""Mirrored surroundings against closed forms."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.scene import (
    constant_background,
    directional_light,
    gradient_background,
    make_object,
    make_scene,
)

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
MIDDLE = (0.5, 0.0, 0.5)  # weights of face 0 at the middle of the square


def seen(scene, eye):
    shader = scene.shader(np.asarray(eye, dtype=float))
    return shader(jnp.asarray(0), jnp.asarray(MIDDLE), jnp.asarray(1e-3))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_mirror_shows_the_sky_in_the_mirrored_direction(side):
    """Seen from 30 degrees above its normal, it shows the sky 30 degrees below the horizon; both sides do."""
    square = make_object("square", SQUARE, FACES, colour=(0, 0, 0), reflectance=(0.5, 1.0, 0.0))
    sky = gradient_background((0.3, 0.6, 0.9), 0.0, 5.0)
    scene = make_scene([square], background=sky)
    eye = (0.0, 4 * np.sin(np.radians(30)), side * 4 * np.cos(np.radians(30)))
    expected = np.array([0.5, 1.0, 0.0]) * np.array([0.3, 0.6, 0.9]) / 3
    np.testing.assert_allclose(seen(scene, eye), expected, atol=1e-12)


def test_what_is_mirrored_is_added_to_the_rest():
    light = directional_light((0, 0, -1))
    square = make_object("square", SQUARE, FACES, specular=0.5, reflectance=0.25)
    scene = make_scene([square], lights=[light], background=constant_background((1.0, 2.0, 4.0)))
    np.testing.assert_allclose(seen(scene, (0, 0, 3)), 0.8 + 0.5 + 0.25 * np.array([1.0, 2.0, 4.0]))


def test_what_no_material_uses_is_none():
    matt, glossy = (make_object("square", SQUARE, FACES, specular=k) for k in (0.0, 0.5))
    light = directional_light((0, 0, -1))
    assert make_scene([matt], lights=[light]).gloss() is None
    assert make_scene([glossy], ambient=1.0).gloss() is None
    lit = make_scene([glossy], lights=[light])
    assert lit.gloss().reflectance is None
    assert lit.gloss().background is None
    mirror = make_scene([make_object("square", SQUARE, FACES, reflectance=1.0)], lights=[light])
    assert mirror.gloss().specular is None
    assert dataclasses.replace(mirror, unlit=True).gloss() is None


@pytest.mark.parametrize("value", [1.5, (0.0, -0.1, 0.0), float("nan")])
def test_reflectances_out_of_range_are_refused(value):
    with pytest.raises(
        ValueError, match=r"reflectance of object 'square' is .* expected finite values of 0 to 1"
    ):
        make_object("square", SQUARE, FACES, reflectance=value)
