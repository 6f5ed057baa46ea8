"""Which face each sample shows, the fringe included; and looks that are worked out part by part."""

import equinox as eqx
import numpy as np
import pytest
import trimesh
from small_scenes import SQUARE, at_pixels, front_camera, patch, varied_objects, wide_lens

from focusjax import _parallel
from focusjax.layers import Layers, _means, _touching, faces_of_samples, peel
from focusjax.scene import directional_light, make_object, make_scene


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


@pytest.mark.parametrize("view_dependent", [False, True])
def test_looks_part_by_part_are_those_of_all_at_once(monkeypatch, view_dependent):
    camera = front_camera()
    lens = wide_lens(camera)
    corners = at_pixels(np.array([(3, 3), (20, 3), (20, 20), (3, 20)]), np.full(4, 1.2), camera)
    pane = make_object("pane", corners, SQUARE, colour=(0.1, 0.4, 0.2), opacity=0.5)
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    glossy = make_object(
        "glossy", mesh.vertices, mesh.faces, specular=0.5, shininess=80.0, translate=(0.1, -0.1, -1.8)
    )
    things = [pane, glossy, *varied_objects()]
    scene = make_scene(things, lights=[directional_light((0.2, -1.0, -0.6), (2.0, 2.0, 2.0))])

    def peeled() -> Layers:
        return peel(scene, camera, lens, supersampling=2, view_dependent=view_dependent)

    whole = peeled()
    monkeypatch.setattr(_means, "_AT_ONCE", 700)
    # Some rows at a time, and in many bands, for the outlines and the looks.
    monkeypatch.setattr(_touching, "_GRID_AT_ONCE", 1500)
    monkeypatch.setattr(_touching, "_LEAST_AT_ONCE", 30)
    monkeypatch.setattr(_parallel, "CORES", 8)
    parts = peeled()
    assert whole.samples_kept > 2000
    assert (whole.samples.gloss is not None) == view_dependent
    assert eqx.tree_equal(parts, whole)
