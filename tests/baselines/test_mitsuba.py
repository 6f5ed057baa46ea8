"""The Mitsuba baseline, in its scalar variant, which needs no LLVM; not part of the `test` extra."""

import dataclasses
import importlib.util
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import at_pixels, front_camera, varied_scene, wide_lens

from focusjax.baselines import (
    counted_mitsuba_picture,
    denoised,
    lens_picture,
    mitsuba,
    mitsuba_picture,
    unlit_scene,
    without_gaps,
)
from focusjax.bench import resized
from focusjax.lens import thin_lens
from focusjax.metrics import psnr
from focusjax.scene import constant_background, make_object, make_scene

CAMERA = front_camera(24, 18)
LENS = wide_lens(CAMERA, pixels_per_dioptre=6.0)
needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed (`bench` extra)"
)
needs_denoiser = pytest.mark.skipif(
    importlib.util.find_spec("pyoidn") is None, reason="Open Image Denoise is not installed (`bench` extra)"
)


def painted_scene():
    """Two crossing triangles, brighter than white in places, before a coloured sky."""
    corners = [(-2, -2), (20, 4), (6, 22), (4, 16), (26, -2), (22, 20)]
    vertices = at_pixels(np.array(corners), np.array([1.0, 0.8, 0.6, 0.3, 0.4, 0.3]), CAMERA)
    colours = np.array([(3.0, 0, 0), (0, 0.5, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (0.2, 0.2, 0.2)])
    shape = make_object("shape", vertices, np.array([(0, 1, 2), (3, 4, 5)]), vertex_colours=colours)
    return make_scene([shape], background=constant_background((0.1, 0.2, 0.3)), unlit=True)


@needs_mitsuba
def test_agrees_with_the_ray_cast():
    scene = painted_scene()
    theirs = mitsuba_picture(unlit_scene(scene), CAMERA, LENS, samples=256, variant="scalar_rgb")
    ours = lens_picture(scene, CAMERA, LENS, rays=256)
    # Observed: 39.4 dB, the noise of 256 samples of colours up to 3; 36.7 by independent ones.
    assert psnr(theirs, ours) > 38.0
    plain = mitsuba_picture(
        unlit_scene(scene), CAMERA, LENS, samples=256, variant="scalar_rgb", sampler="independent"
    )
    assert 35.5 < psnr(plain, ours) < 38.0


@needs_mitsuba
def test_refuses_no_samples_slid_cameras_and_unknown_variants():
    scene = unlit_scene(painted_scene())
    with pytest.raises(ValueError, match="samples is 0; expected a whole number, at least 1"):
        mitsuba_picture(scene, CAMERA, LENS, samples=0)
    risen = dataclasses.replace(CAMERA, principal_point=CAMERA.principal_point + jnp.array([0.0, 2.0]))
    with pytest.raises(ValueError, match=r"passes the picture at \(12, 11\) pixels but .* no rise or shift"):
        mitsuba_picture(scene, risen, LENS, samples=1)
    with pytest.raises(ValueError, match="Mitsuba cannot use its variant no_such"):
        mitsuba_picture(scene, CAMERA, LENS, samples=1, variant="no_such")


def test_refuses_what_it_does_not_draw():
    with pytest.raises(ValueError, match=r"opaque, unlit, white materials .* bake the scene's colours"):
        unlit_scene(varied_scene())


def test_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(ValueError, match="not installed; run `pip install mitsuba`"):
        mitsuba_picture(unlit_scene(painted_scene()), CAMERA, LENS, samples=1)


@needs_mitsuba
def test_silhouettes_have_their_share_of_the_background():
    """A white card whose edge runs through pixels, before a coloured background, in focus all over."""
    corners = np.array([(6.25, -2.0), (30.0, -2.0), (30.0, 22.0), (6.25, 22.0)])
    vertices = at_pixels(corners, np.full(4, 0.5), CAMERA)
    card = make_object("card", vertices, np.array([(0, 1, 2), (0, 2, 3)]), vertex_colours=np.ones((4, 3)))
    scene = make_scene([card], background=constant_background((0.1, 0.5, 2.0)), unlit=True)
    sharp = thin_lens(focus_distance=2.0, aperture_radius=0.01)
    picture = mitsuba_picture(unlit_scene(scene), CAMERA, sharp, samples=256, variant="scalar_rgb")
    np.testing.assert_allclose(picture[:, :6], np.broadcast_to((0.1, 0.5, 2.0), (18, 6, 3)), rtol=1e-6)
    # Radiance is summed in single precision.
    np.testing.assert_allclose(picture[:, 7:], 1.0, rtol=1e-5)
    # Stratified: 256 samples of an edge are off by less than one in 16 of them.
    np.testing.assert_allclose(
        picture[:, 6], np.broadcast_to((0.775, 0.875, 1.25), (18, 3)), atol=0.07, rtol=0
    )


@needs_mitsuba
def test_samples_that_are_not_finite_are_left_out_and_counted(monkeypatch):
    """Of three passes one lacks a pixel, and all lack another."""
    passes = []

    def render(loaded, *, spp, **_):
        picture = np.full((18, 24, 3), float(len(passes)))
        picture[2, 3] = np.nan
        if not passes:
            picture[7, 8, 1] = np.inf
        passes.append(spp)
        return picture

    scene = unlit_scene(painted_scene())
    monkeypatch.setattr(mitsuba("scalar_rgb"), "render", render)
    picture, dropped = counted_mitsuba_picture(scene, CAMERA, LENS, samples=600, variant="scalar_rgb")
    assert (passes, dropped) == ([256, 256, 88], 4)
    assert np.isnan(picture[2, 3]).all()
    sky = np.array(scene.background)
    np.testing.assert_allclose(picture[0, 0], sky + (256 + 2 * 88) / 600)
    np.testing.assert_allclose(picture[7, 8], sky + (256 + 2 * 88) / 344)
    filled = without_gaps(picture)
    np.testing.assert_allclose(filled[2, 3], picture[0, 0])
    picture[1:4, 2:5] = np.nan
    with pytest.raises(ValueError, match=r"pixel \(3, 2\) and all its neighbours are not finite"):
        without_gaps(picture)


@needs_mitsuba
@needs_denoiser
def test_denoising_takes_noise_out():
    scene, camera = painted_scene(), resized(CAMERA, 192, 144)
    noisy = mitsuba_picture(unlit_scene(scene), camera, LENS, samples=4, variant="scalar_rgb")
    truth = lens_picture(scene, camera, LENS, rays=64)
    clean = denoised(noisy)
    assert clean.shape == noisy.shape
    # Observed: 34.4 dB instead of 24.0.
    assert psnr(clean, truth) > psnr(noisy, truth) + 8.0


def test_says_what_denoising_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    with pytest.raises(ValueError, match="Denoise, which is not installed; run `pip install pyoidn`"):
        denoised(np.zeros((4, 4, 3)))
