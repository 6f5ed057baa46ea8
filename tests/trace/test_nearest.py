"""Which surface rays meet first, by the walk through layers, beside a ray cast."""

import jax
import jax.numpy as jnp
import numpy as np
from small_scenes import front_camera, patch, varied_layers, varied_scene, wide_lens

from focusjax.baselines import nearest_in_scene
from focusjax.geometry import LensRay
from focusjax.layers import peel
from focusjax.scene import make_scene
from focusjax.trace import nearest_in_layers


def some_rays(count: int) -> LensRay:
    """Random rays of the wide lens over the whole frame."""
    camera = front_camera()
    lens = wide_lens(camera)
    films, pupils = np.random.default_rng(0).uniform(size=(2, count, 2))
    films = films * [camera.width, camera.height]
    return jax.vmap(lambda film, pupil: lens.ray(camera, film, lens.pupil_point(pupil)))(
        jnp.asarray(films), jnp.asarray(pupils)
    )


def test_a_square_before_nothing():
    """Rays that pass the square's place at its disparity meet it; 0 stands for the others."""
    camera = front_camera()
    scene = make_scene([patch("square", camera, (8, 6, 24, 18), 0.8)], unlit=True)
    rays = some_rays(2000)
    x, y = np.asarray(rays.at(jnp.full(2000, 0.8))).T
    margin = np.minimum.reduce([x - 8, 24 - x, y - 6, 18 - y])
    for nearest in (
        nearest_in_scene(scene, camera),
        nearest_in_layers(peel(scene, camera, wide_lens(camera), supersampling=2)),
    ):
        found = nearest(rays)
        # The walk knows where a ray is to half a sample, a quarter of a pixel.
        np.testing.assert_allclose(found[margin > 0.3], 0.8, rtol=2e-4)
        assert not found[margin < -0.3].any()
        assert ((margin > 0.3).sum() > 300) & ((margin < -0.3).sum() > 300)


def test_layers_give_what_the_ray_cast_gives():
    rays = some_rays(20000)
    ours = nearest_in_layers(varied_layers())(rays)
    theirs = nearest_in_scene(varied_scene(), front_camera())(rays)
    parallax = 2 * 12.0
    # Within a sample's width of movement at the rim of the lens. Observed: 95 %; the walk knows where a ray
    # is to half a sample, which is more in disparity for rays that move less.
    assert (np.abs(ours - theirs) < 1 / parallax).mean() > 0.9
