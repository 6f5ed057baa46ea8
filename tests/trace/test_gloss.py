"""Highlights and mirrored surroundings through a wide lens, against a ray cast shaded in plain numpy."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from glossy import glossy_camera, glossy_lens, glossy_scene, ray_by_ray
from gradients import check_gradients
from small_scenes import front_camera, varied_layers, varied_scene, wide_lens

from focusjax.layers import Layers, peel
from focusjax.metrics import psnr, ssim
from focusjax.trace import render, render_pinhole
from focusjax.trace._gloss import radiance_from_centre
from focusjax.trace._radiances import met_at, surface_of


@cache
def glossy_layers(view_dependent: bool) -> Layers:
    """`glossy_scene`, peeled for the lens whose rays stray most of those below."""
    lens = glossy_lens(2.0)
    return peel(glossy_scene(), glossy_camera(), lens, supersampling=2, view_dependent=view_dependent)


@pytest.mark.parametrize("focus", [pytest.param(0.6, marks=pytest.mark.slow), 2.0])
def test_each_ray_sees_its_own_highlight(focus: float):
    lens = glossy_lens(focus)
    reference = ray_by_ray(glossy_scene(), glossy_camera(), lens, rays=256)
    apart, baked = (
        np.asarray(render(glossy_layers(view_dependent), lens, rays=256)) for view_dependent in (True, False)
    )
    # Observed, focus 0.6 and 2.0: 44.0 and 43.6 dB, SSIM 0.994 and 0.974.
    assert psnr(apart, reference) > 42.0
    assert ssim(apart, reference) > 0.96
    # Observed: 26.5 and 14.8 dB, SSIM 0.975 and 0.775.
    assert psnr(baked, reference) < 30.0
    assert ssim(baked, reference) < ssim(apart, reference) - 0.01


def test_baked_gloss_is_that_of_the_lens_centre():
    lens = glossy_lens(2.0)
    reference = ray_by_ray(glossy_scene(), glossy_camera(), lens, rays=256, baked=True)
    baked = np.asarray(render(glossy_layers(False), lens, rays=256))
    # Observed: 45.4 dB.
    assert psnr(baked, reference) > 42.0


def test_the_pinhole_sees_the_same_either_way():
    apart, baked = (np.asarray(render_pinhole(glossy_layers(apart))) for apart in (True, False))
    assert baked.max() > 2.0
    # What is baked is the mean over a sample's area, what is apart that in its middle, of packed normals.
    # Observed: 8e-4; 0.012 but for 0.6 % of the values, where a highlight ends inside a sample.
    off = np.abs(apart - baked)
    assert off.mean() < 1.2e-3
    assert np.quantile(off, 0.99) < 0.03


def test_scenes_without_gloss_are_what_they_were():
    """Not only the picture: the arrays, and so the programs compiled for them."""
    camera = front_camera()
    layers = peel(varied_scene(), camera, wide_lens(camera), supersampling=2, view_dependent=True)
    assert layers.samples.gloss is None
    assert jax.tree.structure(layers) == jax.tree.structure(varied_layers())
    np.testing.assert_array_equal(layers.radiance, varied_layers().radiance)


def test_gradients_reach_lights_and_materials():
    layers = glossy_layers(True)
    bright = int(layers.samples.index[jnp.argmax(radiance_from_centre(layers)[:, 0])])
    size = layers.grid.rows * layers.grid.columns
    row, column = divmod(bright % size, layers.grid.columns)
    lens, camera, grid = layers.lens, layers.camera, layers.grid
    film = (jnp.array([column, row]) + 0.7 - grid.margin) / grid.supersampling
    ray = lens.ray(camera, film, jnp.array([0.01, -0.02]))
    on_grid = eqx.tree_at(
        lambda r: (r.a, r.b),
        ray,
        (ray.a * grid.supersampling + grid.margin, ray.b * grid.supersampling),
    )
    surface = surface_of(layers)
    model = surface.gloss.model

    def seen(colour: jax.Array, direction: jax.Array, specular: tuple, shininess: jax.Array) -> jax.Array:
        changed = eqx.tree_at(
            lambda m: (m.lights[0].colour, m.lights[0].direction, m.specular, m.shininess),
            model,
            (colour, direction, specular, shininess),
        )
        changed = eqx.tree_at(lambda s: s.gloss.model, surface, changed)
        return jnp.stack(met_at(changed, on_grid, jnp.asarray(bright))[0])

    sun = model.lights[0]
    assert seen(sun.colour, sun.direction, model.specular, model.shininess).max() > 1.0
    # Observed: 3e-9.
    check_gradients(seen, sun.colour, sun.direction, model.specular, model.shininess, rtol=1e-7)
