"""Normals: smooth where faces nearly agree, split at creases, and finite for degenerate meshes."""

import numpy as np
import pytest
import trimesh

from focusjax.scene import make_object
from focusjax.scene._normals import smooth_normals


def test_a_cube_keeps_its_facets():
    cube = trimesh.creation.box()
    item = make_object("cube", cube.vertices, cube.faces)
    normals = item.normals[item.faces]
    np.testing.assert_allclose(normals, np.repeat(cube.face_normals[:, None], 3, axis=1), atol=1e-12)


def test_a_cube_wholly_smooth_points_to_its_corners():
    cube = trimesh.creation.box()
    item = make_object("cube", cube.vertices, cube.faces, smooth_angle=180.0)
    assert len(item.vertices) == 8
    # Weights by angle make the three faces count the same, however their squares are cut in two.
    np.testing.assert_allclose(item.normals, item.vertices / np.sqrt(0.75), atol=1e-12)


def test_a_sphere_is_smooth_and_keeps_its_vertices():
    ball = trimesh.creation.icosphere(subdivisions=3)
    item = make_object("ball", ball.vertices, ball.faces)
    assert len(item.vertices) == len(ball.vertices)
    # Observed on this uneven mesh: 0.0046.
    np.testing.assert_allclose(item.normals, item.vertices, atol=6e-3)


def test_seams_of_texture_coordinates_do_not_show():
    ball = trimesh.creation.icosphere(subdivisions=2)
    corners = ball.vertices[ball.faces].reshape(-1, 3)
    split = make_object("ball", corners, np.arange(len(corners)).reshape(-1, 3))
    whole = make_object("ball", ball.vertices, ball.faces)
    np.testing.assert_allclose(split.normals[split.faces], whole.normals[whole.faces], atol=1e-12)


def test_pairs_of_faces_decide_at_a_partly_sharp_vertex(monkeypatch):
    # A roof of two gentle slopes that ends in a wall: the ridge is smooth, the eaves are sharp.
    vertices = np.array(
        [[0, 0, 0], [2, 0, 0], [0, 0.2, 1], [2, 0.2, 1], [0, 0, 2], [2, 0, 2], [0, -2, 2], [2, -2, 2]]
    )
    faces = np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5], [4, 6, 5], [5, 6, 7]])
    normals = smooth_normals(vertices.astype(float), faces, 40.0)
    np.testing.assert_allclose(normals[0, 1], [0, 1, 0], atol=1e-12)  # ridge
    slope = np.array([0, 1, 0.2]) / np.hypot(1, 0.2)
    np.testing.assert_allclose(normals[2, 1], slope, atol=1e-12)  # eaves, seen from the roof
    np.testing.assert_allclose(normals[4, 0], [0, 0, 1], atol=1e-12)  # eaves, seen from the wall
    # Chunks of pairs make no difference.
    monkeypatch.setattr("focusjax.scene._normals._PAIRS_AT_ONCE", 3)
    np.testing.assert_array_equal(smooth_normals(vertices.astype(float), faces, 40.0), normals)


@pytest.mark.filterwarnings("error")
def test_degenerate_triangles_give_no_nan():
    vertices = np.array(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0], [0, 1e-170, 0], [1e-170, 0, 0], [5, 5, 5]]
    )
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 4, 5], [6, 6, 6]])
    normals = smooth_normals(vertices.astype(float), faces, 40.0)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-9)


def test_normals_that_cancel_out_fall_back_to_the_face():
    # Two faces back to back, forced smooth: the average at each corner is zero.
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    normals = smooth_normals(vertices, np.array([[0, 1, 2], [0, 2, 1]]), 180.0)
    np.testing.assert_allclose(normals[0], np.tile([0, 0, 1.0], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(normals[1], np.tile([0, 0, -1.0], (3, 1)), atol=1e-12)


def test_neither_chunks_nor_collisions_change_anything(monkeypatch):
    random = np.random.default_rng(3)
    # Places that are shared, as they are rounded, and both zeros.
    vertices = random.normal(size=(300, 3)).round(1) * random.choice([-1.0, 1.0], (300, 3))
    faces = random.integers(0, 300, (900, 3))
    whole = smooth_normals(vertices, faces, 40.0)
    monkeypatch.setattr("focusjax.scene._normals._FACES_AT_ONCE", 70)
    np.testing.assert_array_equal(smooth_normals(vertices, faces, 40.0), whole)
    # All hashes are 0.
    monkeypatch.setattr("focusjax.scene._normals._ODD", np.zeros(3, dtype=np.uint64))
    np.testing.assert_array_equal(smooth_normals(vertices, faces, 40.0), whole)
