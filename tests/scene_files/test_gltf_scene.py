"""Scenes of glTF: an object for each node, and lights of KHR_lights_punctual."""

import numpy as np
import pytest
from camera_scenes import write_gltf_scene
from scipy.spatial.transform import Rotation

import focusjax as fj
from focusjax.scene_files import SceneFileError, read_scene

LIGHTS = [
    {"type": "directional", "intensity": 3.0, "color": [1, 0.5, 0]},
    {"type": "point", "intensity": 2.0},
    {"type": "spot", "spot": {}},
]
RIG = {"name": "rig", "children": [1, 2], "translation": [0, 0, 5]}


def lit(number, **more):
    return {"extensions": {"KHR_lights_punctual": {"light": number}}, **more}


def test_nodes_stand_where_their_parents_put_them_below_cameras_too(tmp_path):
    turn = Rotation.from_euler("x", -90, degrees=True).as_quat().tolist()
    nodes = [
        {**RIG, "children": [1, 2, 5, 6]},
        {"name": "eye", "camera": 0, "translation": [1, 0, 0], "children": [3]},
        {"name": "card", "mesh": 0, "scale": [2, 2, 2]},
        {"name": "card", "mesh": 0, "children": [4]},
        lit(1, translation=[0, 2, 0]),
        lit(0, rotation=turn),
        lit(2, name="lamp"),
    ]
    path = write_gltf_scene(tmp_path / "a.gltf", nodes, LIGHTS)
    with pytest.warns(UserWarning, match=r"a\.gltf: lamp is a spot light, which are left out; make them"):
        found = read_scene(path)
    assert [each.name for each in found.objects] == ["card", "card 2"]
    np.testing.assert_allclose(found.objects[0].vertices, [(0, 0, 5), (2, 0, 5), (0, 2, 5)])
    np.testing.assert_allclose(found.objects[1].vertices, [(1, 0, 5), (2, 0, 5), (1, 1, 5)])
    # And in one object of a mesh file.
    assert fj.load_mesh(path).vertices.max(axis=0).tolist() == [2, 2, 5]
    bulb, sun = found.lights
    np.testing.assert_allclose(bulb.position, (1, 2, 5))
    np.testing.assert_allclose(bulb.intensity, [2 / np.pi] * 3)
    np.testing.assert_allclose(sun.direction, (0, -1, 0), atol=1e-12)
    np.testing.assert_allclose(sun.colour, np.array([3, 1.5, 0]) / np.pi)


@pytest.mark.parametrize(
    ("nodes", "said"),
    [
        ([{**RIG, "children": [1]}, {"mesh": 0, "children": [0]}], "is its own ancestor.*export the"),
        ([RIG, {"mesh": 0, "children": [2]}, {"mesh": 0}], "node 2 has two parents, 0 and 1"),
        ([{"mesh": 0, "children": [9]}], "node 0 has a child 9, which is no node"),
        ([{"mesh": 3}], "nodes: .*export the scene again"),
        ([{"mesh": 0, **lit(7)}], "card has light 7, and the file has 3 lights"),
        ([{"name": "empty"}], "has no faces"),
    ],
    ids=["cycle", "two parents", "child", "mesh", "light", "empty"],
)  # fmt: skip
def test_what_is_wrong_is_said(tmp_path, nodes, said):
    with pytest.raises(SceneFileError, match=rf"a\.gltf.* {said}"):
        read_scene(write_gltf_scene(tmp_path / "a.gltf", nodes, LIGHTS))


def test_a_picture_elsewhere_is_refused(tmp_path):
    (tmp_path / "theirs").mkdir()
    path = write_gltf_scene(tmp_path / "theirs" / "a.gltf", [{"mesh": 0}])
    (tmp_path / "secret.bin").write_bytes(bytes(36))
    text = path.read_text()
    start = text.index("data:")
    path.write_text(text[:start] + "../secret.bin" + text[text.index('"', start) :])
    with pytest.raises(SceneFileError, match=r"a\.gltf refers to \.\./secret\.bin, outside the folders"):
        read_scene(path)
