"""Objects that move and deform: positions, normals, and sequences that do not fit."""

import re

import numpy as np
import pytest
import trimesh

from focusjax.scene import load_mesh, make_object, make_scene, placement
from focusjax.shot import (
    Motion,
    MovingScene,
    VertexSequence,
    load_vertex_sequence,
    transforms,
    transforms_of,
)

PLACE = {"translate": (0.3, -0.1, -2.0), "rotate": (10, 200, 5), "scale": (1.0, 2.0, 0.5)}


@pytest.fixture(scope="module")
def ball_file(tmp_path_factory):
    """A ball with a crease: its upper half is a separate, flat-topped part of the same mesh."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    mesh.vertices[mesh.vertices[:, 1] > 0.2, 1] = 0.2
    path = tmp_path_factory.mktemp("meshes") / "ball.ply"
    mesh.export(path)
    return path


def moving(item, motion):
    return MovingScene(make_scene([item], ambient=1.0), [item], {item.name: motion})


def test_a_moved_object_is_as_one_loaded_there(ball_file):
    here, there = load_mesh(ball_file, **PLACE), load_mesh(ball_file, translate=(1, 0, 0), rotate=(0, 30, 0))
    path = transforms({1: PLACE, 9: {"translate": (1, 0, 0), "rotate": (0, 30, 0)}})
    scene = moving(here, Motion(placed=placement(*PLACE.values()), transforms=path))
    assert scene.at(1).vertices == pytest.approx(here.vertices, abs=1e-12)
    assert scene.at(1).normals == pytest.approx(here.normals, abs=1e-9)
    # Creases are those of the mesh as it was placed, so that corners are compared one by one.
    moved = scene.at(20)
    assert moved.vertices[moved.faces] == pytest.approx(there.vertices[there.faces], abs=1e-12)
    assert moved.faces is scene.at(1).faces


def test_only_named_objects_move_and_frames_alike_are_one_scene():
    first, second = (make_object(name, np.eye(3) - (0, 0, 3), [(0, 1, 2)]) for name in ("a", "b"))
    scene = make_scene([first, second], unlit=True)
    path = transforms({3: {"translate": (0, 1, 0)}, 5: {"translate": (0, 2, 0)}}, between="linear")
    found = MovingScene(scene, [first, second], {"b": Motion(transforms=path)})
    assert found.at(4).vertices[:3].tolist() == first.vertices.tolist()
    assert found.at(4).vertices[3:].tolist() == np.add(second.vertices, (0, 1.5, 0)).tolist()
    assert found.at(2) is found.at(3)
    assert found.at(2) is not found.at(4)
    assert MovingScene(scene, [first, second], {}).at(7) is scene


@pytest.mark.parametrize("scale", [1.0, (-1.0, 1.0, 1.0)])
def test_a_deforming_mesh_has_the_normals_of_its_shape(ball_file, tmp_path, scale):
    """An array in the file's order, and numbered files, of a ball that is stretched; mirrored, too."""
    base = trimesh.load(ball_file, process=False)
    steps = np.array([base.vertices * (1, stretch, 1) for stretch in (1.0, 2.0, 3.0)])
    np.savez(tmp_path / "ball.npz", vertices=steps)
    for number, vertices in enumerate(steps, start=7):
        trimesh.Trimesh(vertices, base.faces, process=False).export(tmp_path / f"ball_{number:03d}.ply")
    item = load_mesh(ball_file, scale=scale)
    found = {}
    for name in ("ball.npz", "ball_###.ply"):
        sequence = load_vertex_sequence(tmp_path / name, item, first_frame=2, frames_per_step=2)
        scene = moving(item, Motion(placement((0, 0, 0), (0, 0, 0), scale), vertices=sequence))
        assert scene.at(1).vertices == pytest.approx(item.vertices, abs=1e-6)
        found[name] = [scene.at(frame) for frame in (4, 5, 30)]
    factors = np.array(scale) * np.ones(3)
    for scene, stretch in zip(found["ball.npz"], (2.0, 2.5, 3.0), strict=True):
        expected = load_mesh(ball_file, scale=(factors * (1, stretch, 1)).tolist())
        corners = scene.vertices[scene.faces]
        assert corners == pytest.approx(expected.vertices[expected.faces], abs=1e-6)
        agree = np.sum(scene.normals[scene.faces] * expected.normals[expected.faces], axis=-1)
        # Where neither is creased; they weigh the triangles around a vertex in two ways. Observed: 0.9954.
        smooth = (np.abs(item.vertices[item.faces][..., 1]) < 0.1).all(axis=1)
        assert smooth.sum() == 16
        assert agree[smooth].min() > 0.98
    for one, other in zip(*found.values(), strict=True):
        assert one.vertices == pytest.approx(other.vertices, abs=1e-6)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (
            np.zeros((4, 9, 3)),
            "has 9 vertices per step but object 'ball' has 162; export it from the same mesh",
        ),
        (np.zeros((162, 3)), "has an array of shape (162, 3); expected [steps, vertices, 3]"),
        (np.full((2, 162, 3), np.nan), "has values that are not finite in step 0"),
        (np.zeros((0, 162, 3)), "is empty; expected at least one set of vertices"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(ball_file, tmp_path, array, message):
    np.savez(tmp_path / "walk.npz", array)
    with pytest.raises(ValueError, match=re.escape(f"vertex sequence {tmp_path / 'walk.npz'} {message}")):
        load_vertex_sequence(tmp_path / "walk.npz", load_mesh(ball_file))


def test_files_that_do_not_fit_are_refused(ball_file, tmp_path):
    item, base = load_mesh(ball_file), trimesh.load(ball_file, process=False)
    with pytest.raises(ValueError, match="does not exist; check the path"):
        load_vertex_sequence(tmp_path / "no.npz", item)
    (tmp_path / "text.npz").write_text("no array")
    with pytest.raises(ValueError, match=r"text.npz cannot be read"):
        load_vertex_sequence(tmp_path / "text.npz", item)
    np.savez(tmp_path / "two.npz", np.zeros((1, 2, 3)), np.zeros((1, 2, 3)))
    with pytest.raises(ValueError, match=re.escape("holds the arrays ['arr_0', 'arr_1']; expected just one")):
        load_vertex_sequence(tmp_path / "two.npz", item)
    with pytest.raises(ValueError, match="matches no file"):
        load_vertex_sequence(tmp_path / "a_##.ply", item)
    for number in (1, 3):
        base.export(tmp_path / f"a_{number:02d}.ply")
    with pytest.raises(ValueError, match="lacks number 2; number the files without gaps"):
        load_vertex_sequence(tmp_path / "a_##.ply", item)
    turned = trimesh.Trimesh(base.vertices, base.faces[::-1], process=False)
    turned.export(tmp_path / "a_02.ply")
    with pytest.raises(
        ValueError, match=r"a_02.ply has other triangles than object 'ball'; export all steps"
    ):
        load_vertex_sequence(tmp_path / "a_##.ply", item)
    trimesh.Trimesh(base.vertices, base.faces[1:], process=False).export(tmp_path / "a_02.ply")
    with pytest.raises(ValueError, match=re.escape("than object 'ball' (319 against 320)")):
        load_vertex_sequence(tmp_path / "a_##.ply", item)
    with pytest.raises(ValueError, match="0 frames per step; expected a positive number"):
        VertexSequence(np.zeros((1, 1, 3)), frames_per_step=0)


def test_motions_that_do_not_fit_are_refused():
    card = make_object("card", np.eye(3), [(0, 1, 2)])
    scene = make_scene([card], unlit=True)
    with pytest.raises(ValueError, match="there is no object named 'cart'; did you mean 'card'"):
        MovingScene(scene, [card], {"cart": Motion()})
    with pytest.raises(ValueError, match="the objects are not those that the scene was made of"):
        MovingScene(scene, [card, card], {})
    with pytest.raises(
        ValueError, match=re.escape("at frame 1 has ['turn']; expected translate, rotate and")
    ):
        transforms({1: {"turn": 3.0}})
    with pytest.raises(ValueError, match="the scale changes its sign between keyframes"):
        transforms({1: {"scale": 1.0}, 2: {"scale": -1.0}})
    with pytest.raises(ValueError, match="another sign of its scale than its keyframes have"):
        MovingScene(scene, [card], {"card": Motion(transforms=transforms({1: {"scale": (-1, 1, 1)}}))})


def test_matrices_of_a_file_are_placements():
    placed = placement((0.3, -0.1, -2.0), (10, 200, 5), (-1.0, 2.0, 0.5))
    turned = placement((0.3, -0.1, -1.0), (10, 220, 5), (-1.0, 2.0, 0.5))
    path = transforms_of({1: placed, 2: turned})
    np.testing.assert_allclose(path(1), placed, atol=1e-12)
    np.testing.assert_allclose(path(2), turned, atol=1e-12)
    assert path(1.5)[2, 3] == pytest.approx(-1.5)
    for wrong, said in (
        (np.diag([1.0, 0, 1, 1]), "is flat at frame 2"),
        (np.eye(4) + np.eye(4, k=1) * 0.2, "is skewed at frame 2"),
        (np.diag([-1.0, 1, 1, 1]) @ placed, "is mirrored in some frames only"),
    ):
        with pytest.raises(ValueError, match=said):
            transforms_of({1: placed, 2: wrong})
