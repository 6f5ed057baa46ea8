"""The Mitsuba baseline, in its scalar variant, which needs no LLVM; not part of the `test` extra."""

import dataclasses
import importlib.util
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import at_pixels, front_camera, varied_scene, wide_lens

from focusjax.baselines import lens_picture, mitsuba_picture, unlit_scene
from focusjax.metrics import psnr
from focusjax.scene import constant_background, make_object, make_scene

CAMERA = front_camera(24, 18)
LENS = wide_lens(CAMERA, pixels_per_dioptre=6.0)
needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed (`bench` extra)"
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
