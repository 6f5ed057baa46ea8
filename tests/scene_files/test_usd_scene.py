"""Stages of USD become scenes: meshes, pictures, lights and frames; what cannot be read is said."""

import json
import re
import zipfile

import numpy as np
import pytest
from camera_scenes import write_usd_scene

import focusjax as fj
from focusjax.scene_files import SceneFileError, read_scene

pytest.importorskip("pxr.Usd", reason="usd-core is not installed")

INSTANCER = """def PointInstancer "grass" {
    point3f[] positions = [(0, 0, 0)]
    int[] protoIndices = [0]
    rel prototypes = </World/wall>
}"""


@pytest.mark.parametrize(("unit", "axis"), [(1.0, "Y"), (0.01, "Z")])
def test_meshes_lights_and_frames_are_in_metres_with_y_up(tmp_path, unit, axis):
    found = read_scene(write_usd_scene(tmp_path, unit=unit, axis=axis))
    card, wall = found.objects
    assert (card.name, wall.name) == ("card", "wall")
    low, high = card.vertices.min(axis=0), card.vertices.max(axis=0)
    # Observed 2e-9: points are of single precision.
    np.testing.assert_allclose([low, high], [(-0.2, -0.2, -1), (0.2, 0.2, -1)], atol=1e-7)
    np.testing.assert_allclose(wall.vertices[:, 2], -2, atol=1e-6)
    for each in (card, wall):
        # Towards the camera, of the left-handed one too.
        np.testing.assert_allclose(each.normals, [(0, 0, 1)] * len(each.normals), atol=1e-6)
    np.testing.assert_allclose(wall.colours, [(0.2, 0.4, 0.6)] * len(wall.colours), rtol=1e-6)
    (paper,) = card.materials
    np.testing.assert_allclose(paper.emission, (0.5, 0, 0))
    np.testing.assert_allclose(card.textures[paper.texture][:, 0], [(1, 0, 0), (0, 1, 0)])
    top = card.vertices[:, 1] > 0
    np.testing.assert_allclose(card.uv[:, 1], top)
    sun, bulb = found.lights
    np.testing.assert_allclose(sun.direction / np.linalg.norm(sun.direction), (0, 0, -1), atol=1e-6)
    # An irradiance of 3 * 2; a radiance of 8 on a ball of 0.1 m.
    np.testing.assert_allclose(sun.colour, [6 / np.pi] * 3, rtol=1e-6)
    np.testing.assert_allclose(bulb.position, (1, 2, 3), rtol=1e-6)
    np.testing.assert_allclose(bulb.intensity, [0.08, 0.04, 0], rtol=1e-5)
    np.testing.assert_allclose(found.ambient, [0.25] * 3)
    np.testing.assert_allclose(found.background, [0.25] * 3)
    assert (found.frames, found.fps) == (3, 12)
    assert set(found.motions) == {"card"}
    np.testing.assert_allclose(found.motions["card"][:, 0, 3], [0, 0.1, 0.2], atol=1e-12)


def test_a_package_holds_its_pictures(tmp_path):
    from pxr import UsdUtils

    write_usd_scene(tmp_path)
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "shot.usda"), str(tmp_path / "apart.usdz"))
    (tmp_path / "apart").mkdir()
    packed = (tmp_path / "apart.usdz").rename(tmp_path / "apart" / "shot.usdz")
    (card, _) = read_scene(packed, within=[packed.parent]).objects
    assert len(card.textures) == 1
    assert fj.read_camera(packed, within=[packed.parent]).f_number == 2


def test_parts_of_a_mesh_have_their_materials(tmp_path):
    subset = """uniform token subsetFamily:materialBind:familyType = "nonOverlapping"
            def GeomSubset "half" (prepend apiSchemas = ["MaterialBindingAPI"]) {
                uniform token elementType = "face"
                uniform token familyName = "materialBind"
                int[] indices = [1]
                rel material:binding = </World/plain>
            }"""
    plain = """def Material "plain" {
        token outputs:surface.connect = </World/plain/s.outputs:surface>
        def Shader "s" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.1, 0.2, 0.3)
            float inputs:opacity = 0.5
            token outputs:surface
        }
    }"""
    path = write_usd_scene(tmp_path, card=subset, more=plain)
    text = path.read_text()
    for old, new in (
        ("Counts = [4]", "Counts = [3, 3]"),
        ("[0, 1, 2, 3]", "[0, 1, 2, 0, 2, 3]"),
        ("(1, 1), (0, 1)]", "(1, 1), (0, 0), (1, 1), (0, 1)]"),
    ):
        text = text.replace(old, new)
    path.write_text(text)
    card = read_scene(path).objects[0]
    half, rest = card.materials
    np.testing.assert_allclose(half.base_colour, (0.1, 0.2, 0.3), rtol=1e-6)
    assert (half.opacity, half.texture, rest.texture) == (0.5, -1, 0)
    assert card.face_material.tolist() == [0, 1]


def test_what_is_left_out_is_said(tmp_path):
    others = """def Sphere "ball" {}
    def RectLight "window" {}
    def Mesh "soft" {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
    }
    def Mesh "unseen" {
        token visibility = "invisible"
    }"""
    path = write_usd_scene(tmp_path, more=others)
    with pytest.warns() as caught:
        found = read_scene(path)
    said = sorted(str(each.message).removeprefix(f"{path}: ") for each in caught)
    assert said[0].startswith("only meshes are read; left out: ball (Sphere), so")
    assert said[1].startswith("subdivision is not read, and polygons are shown as they are, of soft (Mesh)")
    assert said[2].startswith("window (RectLight) is left out: focusjax has distant lights")
    assert len(said) == 3
    assert [each.name for each in found.objects] == ["card", "wall", "soft"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"more": INSTANCER}, "/World/grass places instances at points.*make the instances real"),
        (
            {"card": "point3f[] points.timeSamples = { 3: [(0, 0, 0)], 4: [(0, 0, 1)] }"},
            "has animated points.*alone",
        ),
        ({"card": "int[] faceVertexIndices = [0, 1, 2, 9]"}, "do not fit its 4 points"),
    ],
    ids=["instancer", "animated points", "faces"],
)  # fmt: skip
def test_what_cannot_be_read_is_refused(tmp_path, changes, said):
    path = write_usd_scene(tmp_path, **changes)
    if "card" in changes:
        # An attribute is said once.
        name = "points" if "points" in changes["card"] else "faceVertexIndices"
        lines = path.read_text().splitlines()
        first = next(k for k, line in enumerate(lines) if f"[] {name} = " in line)
        path.write_text("\n".join(lines[:first] + lines[first + 1 :]))
    with pytest.raises(SceneFileError, match=rf"shot\.usda.*{said}"):
        read_scene(path)


def test_gltf_nodes_that_are_not_there_are_refused(tmp_path):
    content = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [7]}], "nodes": [{}]}
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    with pytest.raises(
        SceneFileError, match=r"a\.gltf .*scene 0 has node 7, and there are 1 nodes\); export"
    ):
        read_scene(tmp_path / "a.gltf")


def test_files_that_are_up_to_something(tmp_path):
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    path = write_usd_scene(theirs)
    path.write_text(path.read_text().replace("@card.png@", "@../secret.png@"))
    (theirs / "card.png").rename(tmp_path / "secret.png")
    with pytest.raises(SceneFileError, match=r"shot\.usda: refers to .*secret\.png, outside the folders"):
        read_scene(path)
    assert read_scene(path, within=[str(tmp_path)]).objects[0].textures
    bomb = theirs / "bomb.usdz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr("shot.usda", "#usda 1.0\n" + " " * 1_000_000)
    for reader in (read_scene, fj.read_camera):
        with pytest.raises(SceneFileError, match=r"bomb\.usdz: holds shot\.usda compressed.*with usdzip"):
            reader(bomb)
    bomb.write_bytes(bomb.read_bytes()[:300])
    with pytest.raises(SceneFileError, match=r"bomb\.usdz: is no whole usdz package.*export it again"):
        read_scene(bomb)
    path.write_text(path.read_text().replace("(\n", "(\n    subLayers = [@gone.usda@]\n", 1))
    with pytest.warns(
        UserWarning, match=r"shot\.usda: Could not load sublayer @gone\.usda@.*check its paths"
    ):
        read_scene(path, within=[tmp_path])
    empty = theirs / "empty.usda"
    empty.write_text('#usda 1.0\ndef Camera "hero" {}\n')
    with pytest.raises(SceneFileError, match=r"empty\.usda: has no meshes to be seen"):
        read_scene(empty)
    empty.write_text('#usda 1.0\ndef Xform "a" {}\n')
    with pytest.raises(
        SceneFileError, match=r"empty\.usda: has no camera; export the scene with one, or give"
    ):
        fj.read_camera(empty)


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf"])
def test_a_unit_of_no_length_is_refused(tmp_path, unit):
    path = write_usd_scene(tmp_path)
    text = re.sub("metersPerUnit = .*", f"metersPerUnit = {unit}", path.read_text())
    path.write_text(text)
    expected = rf"shot\.usda: metersPerUnit is {unit}; expected a positive number, so set it to 1"
    for read in (read_scene, fj.read_camera):
        with pytest.raises(SceneFileError, match=expected):
            read(path)


@pytest.mark.parametrize(
    ("head", "body", "said"),
    [
        ("subLayers = [@./shot.usda@]", "", r"by a sublayer; remove that sublayer"),
        ("subLayers = [@./other.usda@]", "", r"by a sublayer; remove that sublayer"),
        ("", 'def "more" (references = @./shot.usda@</more>) {}', r"by a reference at /more; remove"),
    ],
    ids=["itself", "another that includes it", "a reference"],
)
def test_a_stage_that_includes_itself_is_refused(tmp_path, head, body, said):
    path = write_usd_scene(tmp_path)
    path.write_text(path.read_text().replace("metersPerUnit", f"{head}\n    metersPerUnit", 1) + body)
    (tmp_path / "other.usda").write_text("#usda 1.0\n(subLayers = [@./shot.usda@])\n")
    for read in (read_scene, fj.read_camera):
        with pytest.raises(SceneFileError, match=rf"shot\.usda: includes itself {said}"):
            read(path, within=[tmp_path])


@pytest.mark.parametrize("below", [[0], [1]], ids=["itself", "its child"])
def test_gltf_nodes_in_a_cycle_are_refused(tmp_path, below):
    nodes = [{"mesh": 0, "children": below}, {"children": [0]} if below == [1] else {}]
    content = {"asset": {"version": "2.0"}, "meshes": [{"primitives": []}], "nodes": nodes}
    (tmp_path / "loop.gltf").write_text(json.dumps(content))
    with pytest.raises(SceneFileError, match=r"loop\.gltf .*its own ancestor\); export the scene again"):
        read_scene(tmp_path / "loop.gltf")


MESH = """#usda 1.0
def Mesh "card"
{{
    point3f[] points = [(0, 0, 0), ({x}, 0, 0), (0, 1, 0)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    uniform token subdivisionScheme = "none"
    double3 xformOp:translate = ({place}, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""


@pytest.mark.parametrize(
    ("x", "place", "said"),
    [
        ("nan", "0", "mesh /card has 1 vertices with NaN or infinite coordinates"),
        ("1", "inf", "the transform of /card is not finite; place it anew"),
    ],
)
def test_what_is_nowhere_is_refused_by_name(tmp_path, x, place, said):
    path = tmp_path / "a.usda"
    path.write_text(MESH.format(x=x, place=place))
    with pytest.raises(SceneFileError, match=rf"a\.usda: {said}"):
        read_scene(path)


def test_a_file_that_is_cut_off_is_refused_in_a_short_sentence(tmp_path):
    path = write_usd_scene(tmp_path)
    text = path.read_text()
    # In the middle of a word, of which the parser expected many.
    path.write_text(text[: text.index("connect") + 3])
    with pytest.raises(
        SceneFileError, match=r"cannot be read as USD .*parse error at 'con'.*export it again"
    ) as e:
        read_scene(path)
    assert "pxrInternal" not in str(e.value)
    assert len(str(e.value)) < 300 + len(str(path))
