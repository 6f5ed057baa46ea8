"""Which face each sample shows, the fringe included; and looks that are worked out part by part."""

import numpy as np
from small_scenes import front_camera, patch, varied_scene, wide_lens

from focusjax.layers import _means, faces_of_samples, peel
from focusjax.scene import make_scene


def test_fringe_samples_show_the_surface_that_they_continue():
    camera = front_camera()
    # Edges between samples' centres leave squares that only the fringe reaches.
    card = patch("card", camera, (8.7, 6.7, 20.3, 16.3), 1.5, (0.9, 0.0, 0.0))
    wall = patch("wall", camera, (-60, -60, 90, 90), 0.25, (0.0, 0.3, 0.0))
    scene = make_scene([card, wall], unlit=True)
    layers = peel(scene, camera, wide_lens(camera))
    faces, samples = faces_of_samples(layers), layers.samples
    held = np.asarray(samples.triangle)
    np.testing.assert_array_equal(faces[held >= 0], held[held >= 0])
    fringe = np.flatnonzero((held < 0) & (np.asarray(samples.disparity) > 0))
    assert len(fringe) > 20
    red = np.asarray(samples.radiance)[fringe, 0] > 0.5
    assert red.any()
    np.testing.assert_array_equal(np.isin(faces[fringe], scene.face_range("card")), red)
    assert (faces[np.asarray(samples.disparity) == 0] == -1).all()


def test_looks_part_by_part_are_those_of_all_at_once(monkeypatch):
    camera = front_camera()
    lens = wide_lens(camera)
    whole = peel(varied_scene(), camera, lens, supersampling=2)
    monkeypatch.setattr(_means, "_AT_ONCE", 700)
    parts = peel(varied_scene(), camera, lens, supersampling=2)
    assert whole.samples_kept > 2000
    np.testing.assert_array_equal(parts.samples.radiance, whole.samples.radiance)
