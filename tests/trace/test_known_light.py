"""Lenses that vignette: what is plain stays plain, whichever rays pass, and pictures are nearer the truth."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_scene, wide_lens

from focusjax.geometry import Camera, LensRay
from focusjax.layers import Layers, peel
from focusjax.lens import AbstractLens, AbstractLensWrapper, VignettedLens, vignetted_lens
from focusjax.scene import constant_background, make_scene
from focusjax.trace import render
from focusjax.trace._known_light import known_light

SKY = np.array([0.1, 0.2, 0.3])
SHIFT, DISK = 2.4, 1.1


class ByItsRays(AbstractLensWrapper):
    """The same lens, of which nothing is known but its rays."""

    lens: AbstractLens

    def vignettes(self) -> bool:
        return False

    def ray(self, camera: Camera, film_point, pupil_point) -> LensRay:
        return self.lens.ray(camera, film_point, pupil_point)

    def footprint(self, camera: Camera, film_point, disparity):
        return self.lens.footprint(camera, film_point, disparity)

    def reach(self, camera: Camera, disparity):
        return self.lens.reach(camera, disparity)

    def parallax(self, camera: Camera):
        return self.lens.parallax(camera)


@cache
def camera() -> Camera:
    return front_camera(64, 48)


@cache
def tube() -> VignettedLens:
    """Dark in the corners: the eye closes at a shift of 2.1."""
    return vignetted_lens(wide_lens(camera(), focus=0.0), camera(), corner_shift=SHIFT, disk=DISK)


@cache
def sky() -> Layers:
    """Of one radiance all over, a wall before it as well."""
    wall = patch("wall", camera(), (10, 10, 40, 30), 0.3, SKY)
    scene = make_scene([wall], background=constant_background(SKY), unlit=True)
    return peel(scene, camera(), tube(), supersampling=1)


@cache
def varied() -> Layers:
    return peel(varied_scene(), camera(), tube(), supersampling=1)


def expected() -> np.ndarray:
    """The light of each pixel [h, w] in closed form: what the opening shares with a disk of hard edge."""
    x, y = np.meshgrid(np.arange(64) + 0.5 - 32, np.arange(48) + 0.5 - 24)
    apart = np.maximum(SHIFT * np.hypot(x, y) / 40, 1e-9)
    first = np.arccos(np.clip((apart**2 + 1 - DISK**2) / (2 * apart), -1, 1))
    second = np.arccos(np.clip((apart**2 + DISK**2 - 1) / (2 * apart * DISK), -1, 1))
    shared = first - np.sin(2 * first) / 2 + DISK**2 * (second - np.sin(2 * second) / 2)
    return shared / np.pi


def test_a_uniform_scene_shows_the_share_that_passes_and_no_rays():
    picture = np.asarray(render(sky(), tube(), rays=16, even=True))
    known = known_light(tube(), camera())
    assert known is not None
    light, doubt = (np.asarray(part).reshape(48, 64, 3) for part in (known.share, known.doubt))
    # By the disk's soft edge and the spline. Observed: 0.014, 0.0012 RMS.
    np.testing.assert_allclose(light[..., 0], expected(), atol=0.02)
    plain = (expected() > 0.3) & (doubt[..., 0] == 0)
    assert plain.mean() > 0.4
    # Observed: 4e-16. By its own rays alone: 0.35, and 0.09 RMS.
    np.testing.assert_allclose((picture / SKY)[plain], light[plain], rtol=1e-5)
    assert (expected()[:2, :2] == 0).all()
    assert (picture[:2, :2] == 0).all()


@pytest.mark.slow
def test_pictures_are_nearer_to_the_truth():
    plain = ByItsRays(tube())
    truth = np.asarray(render(varied(), plain, rays=2048, even=True, seed=9))
    for rays in (16, 512):
        by_known, by_rays = (
            ((np.asarray(render(varied(), lens, rays=rays, smooth=False)) - truth) ** 2).mean()
            for lens in (tube(), plain)
        )
        # Observed: 2.3e-4 and 6.4e-4 with 16 rays, 3.7e-6 and 6.0e-6 with 512.
        assert by_known < 0.8 * by_rays


@pytest.mark.slow
def test_the_differentiable_picture_is_the_same_and_linear_in_radiances():
    layers = varied()
    picture = np.asarray(render(layers, tube(), rays=8, even=True, pixel_filter="box"))

    @jax.jit
    def both(background):
        def seen(scale):
            look = jax.tree.map(lambda a: a * scale, (layers.samples.radiance, background))
            lit = eqx.tree_at(lambda all_: (all_.samples.radiance, all_.background), layers, look)
            return render(lit, tube(), even=True, rays=8)

        return jax.jvp(seen, (jnp.ones(()),), (jnp.ones(()),))

    same, change = both(layers.background)
    # Observed: 4e-16 both.
    np.testing.assert_allclose(same, picture, atol=1e-6)
    np.testing.assert_allclose(change, picture, atol=1e-6)


def test_lenses_that_let_all_pass_have_none():
    assert known_light(tube().lens, camera()) is None
