"""Files that other programs write: hierarchies, units, several cameras; and those that cannot be used."""

import json
import struct

import numpy as np
import pytest
from camera_scenes import write_gltf, write_usd
from scipy.spatial.transform import Rotation

import focusjax as fj
from focusjax.scene_files import SceneFileError


def test_a_gltf_camera_stands_where_its_parents_put_it(tmp_path):
    turn = Rotation.from_euler("y", 90, degrees=True)
    nodes = [
        {"name": "world", "children": [1], "scale": [2, 2, 2], "translation": [0, 0, 5]},
        {"name": "rig", "children": [2], "rotation": turn.as_quat().tolist()},
        {"name": "eye", "camera": 0, "translation": [1, 0, 0]},
    ]
    found = fj.read_camera(write_gltf(tmp_path / "c.gltf", nodes))
    assert found.name == "eye"
    # Turned by 90 degrees about y, 1 to the right is 1 ahead, and scaled 2; scale leaves the camera rigid.
    np.testing.assert_allclose(found.pose[:3, 3], [0, 0, 3], atol=1e-12)
    np.testing.assert_allclose(found.pose[:3, :3], turn.as_matrix(), atol=1e-12)
    assert found.field_of_view == 0.7
    assert found.focus_distance is None
    assert found.resolution is None


def test_the_same_from_a_binary_file_with_a_matrix(tmp_path):
    matrix = np.eye(4)
    matrix[:3, 3] = (1, 2, 3)
    text = write_gltf(tmp_path / "c.gltf", [{"camera": 0, "matrix": matrix.T.ravel().tolist()}]).read_bytes()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON")
    (tmp_path / "c.glb").write_bytes(header + text)
    found = fj.read_camera(tmp_path / "c.glb")
    np.testing.assert_allclose(found.pose, matrix)
    assert found.name == "film"


@pytest.mark.parametrize(
    ("nodes", "name", "said"),
    [
        ([{"mesh": 0}], None, "has no camera"),
        ([{"camera": 0, "name": "a"}, {"camera": 0, "name": "b"}], None, "2 cameras, a and b; say which"),
        ([{"camera": 0, "name": "left"}], "lef", "did you mean 'left'"),
        ([{"camera": 0, "children": [1]}, {"children": [0]}], None, "its own ancestor"),
        ([{"camera": 0, "scale": [1, 1, -1]}], None, "skewed or mirrored"),
        ([{"camera": 0, "scale": [1, 0, 1]}], None, "has no inverse"),
        ([{"camera": 0, "translation": [0, np.inf, 0]}], None, "node 0 has a translation that is not finite"),
        ([{"camera": 7}], None, "no valid glTF file"),
        ([{"camera": 0, "rotation": [0, 0]}], None, "no valid glTF file"),
    ],
    ids=["none", "several", "a slip", "a cycle", "mirrored", "flat", "nowhere", "index", "numbers"],
)
def test_what_is_wrong_with_a_gltf_file_is_said(tmp_path, nodes, name, said):
    with pytest.raises(SceneFileError, match=said):
        fj.read_camera(write_gltf(tmp_path / "c.gltf", nodes), name)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "c.gltf").write_text("{")
    (tmp_path / "c.fbx").write_text("")
    for name, said in (
        ("c.gltf", "cannot be|can be read"),
        ("c.fbx", "no file of scenes with cameras"),
        ("d.glb", "exist"),
    ):
        with pytest.raises(SceneFileError, match=said):
            fj.read_camera(tmp_path / name)
    flat = json.loads(write_gltf(tmp_path / "o.gltf", [{"camera": 0}]).read_text())
    flat["cameras"][0] = {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1}}
    (tmp_path / "o.gltf").write_text(json.dumps(flat))
    with pytest.raises(SceneFileError, match="orthographic; expected one in perspective"):
        fj.read_camera(tmp_path / "o.gltf")


def test_a_usd_camera_in_centimetres_under_a_moving_parent(tmp_path):
    pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    found = fj.read_camera(write_usd(tmp_path / "shot.usda"), "hero")
    # 200 cm up z is 2 m up y; looking down -z is looking down -y.
    np.testing.assert_allclose(found.pose[:3, 3], [0.1, 2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.pose[:3, 2], [0.0, 1.0, 0.0], atol=1e-12)
    assert found.focal_length == pytest.approx(0.035, rel=1e-6)
    assert found.sensor_width == pytest.approx(0.024, rel=1e-6)
    assert found.focus_distance == pytest.approx(1.5, rel=1e-6)
    assert found.f_number == pytest.approx(2.8, rel=1e-6)
    # Nobody set a focus distance.
    assert fj.read_camera(tmp_path / "shot.usda", "witness").focus_distance is None


def test_what_is_wrong_with_a_usd_file_is_said(tmp_path):
    pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    (tmp_path / "broken.usda").write_text("#usda 1.0\ndef Camera {")
    with pytest.raises(SceneFileError, match="cannot be read as USD"):
        fj.read_camera(tmp_path / "broken.usda")
    apart = tmp_path / "apart"
    apart.mkdir()
    write_usd(tmp_path / "shot.usda")
    (apart / "over.usda").write_text("#usda 1.0\n(\n    subLayers = [@../shot.usda@]\n)\n")
    assert fj.read_camera(apart / "over.usda", "hero", within=[tmp_path]).name == "hero"
    with pytest.raises(SceneFileError, match="outside the folders that may be read"):
        fj.read_camera(apart / "over.usda", "hero")
