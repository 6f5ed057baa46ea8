"""glTF files hold the camera by the specification, and the rest in extras."""

import base64
import json
import math

import numpy as np
import pytest
from exchange_cameras import HEIGHT, WIDTH, projected, round_lens, slid_camera, turned_lens, world_points
from scipy.spatial.transform import Rotation

import focusjax as fj


def exported(tmp_path, camera, lens, **options):
    fj.export_camera(camera, lens, tmp_path / "c.gltf", to="gltf", **options)
    return json.loads((tmp_path / "c.gltf").read_text())


def test_points_are_where_gltf_projects_them(tmp_path):
    camera = slid_camera(shift=0.0, rise=0.0)
    document = exported(tmp_path, camera, turned_lens())
    node, view = document["nodes"][0], document["cameras"][0]["perspective"]
    turn = Rotation.from_quat(node["rotation"]).as_matrix()
    x, y, z = ((world_points() - node["translation"]) @ turn).T
    up = math.tan(view["yfov"] / 2)
    there = np.stack([x / -z / up / view["aspectRatio"], -y / -z / up], axis=1)
    pixels = (there + 1) / 2 * (WIDTH, HEIGHT)
    np.testing.assert_allclose(pixels, projected(camera, world_points()), atol=1e-9)
    said = document["cameras"][0]["extras"]["focusjax"]
    assert said["f_number"] == pytest.approx(2.0)
    assert said["focus_distance_m"] == pytest.approx(1.2)
    assert said["tilt_rad"] == pytest.approx(0.1)
    assert said["swing_rad"] == pytest.approx(-0.05)
    assert (said["blades"], said["roundness"]) == (5, 0.2)


def floats(document, number):
    accessor = document["accessors"][number]
    view = document["bufferViews"][accessor["bufferView"]]
    data = base64.b64decode(document["buffers"][0]["uri"].partition("base64,")[2])
    wide = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    values = np.frombuffer(data, "<f4", accessor["count"] * wide, view["byteOffset"])
    return values.reshape(-1, wide)


def test_a_shot_moves_turns_and_zooms(tmp_path):
    places = [(0.2, 0.3, 1.2), (0.3, 0.3, 1.1), (0.5, 0.2, 1.0)]
    cameras = [
        fj.look_at(place, (0, 0, 0), width=WIDTH, height=HEIGHT, focal_length=0.05 + 0.01 * index)
        for index, place in enumerate(places)
    ]
    document = exported(tmp_path, cameras, [round_lens()] * 3, fps=25)
    animation = document["animations"][0]
    tracks = {channel["target"]["path"]: channel["sampler"] for channel in animation["channels"]}
    outputs = {
        path: floats(document, animation["samplers"][sampler]["output"]) for path, sampler in tracks.items()
    }
    times = floats(document, animation["samplers"][0]["input"])
    np.testing.assert_allclose(times[:, 0], [0.0, 0.04, 0.08], rtol=1e-6)
    np.testing.assert_allclose(outputs["translation"], places, rtol=1e-6)
    for turn, camera in zip(outputs["rotation"], cameras, strict=True):
        there = np.asarray(camera.world_from_camera)[:3, :3]
        np.testing.assert_allclose(Rotation.from_quat(turn).as_matrix(), there, atol=1e-6)
    height = 0.036 * HEIGHT / WIDTH
    fields = [2 * math.atan(height / 2 / (0.05 + 0.01 * index)) for index in range(3)]
    np.testing.assert_allclose(outputs["pointer"][:, 0], fields, rtol=1e-6)
    assert document["extensionsUsed"] == ["KHR_animation_pointer"]
    assert len(document["cameras"][0]["extras"]["focusjax"]["frames"]) == 3
