"""Extensions of glTF: integers as attributes, moved pictures, and what is refused or said."""

import base64
import io
import json
import math
import warnings

import numpy as np
import pytest
from camera_scenes import write_gltf_scene
from PIL import Image

import focusjax as fj
from focusjax.scene_files import SceneFileError, read_scene

CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, -1)]
KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "f4": 5126}
CHAIR = [{"name": "chair", "mesh": 0}]


def changed(path, change, nodes=CHAIR):
    """`write_gltf_scene` with its JSON changed."""
    content = json.loads(write_gltf_scene(path, nodes).read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def with_arrays(content, **arrays):
    """Attributes of the triangle, each an array that is stored as it is, and whether it is normalised."""
    for name, (values, normalised) in arrays.items():
        row = -(-values.shape[1] * values.itemsize // 4) * 4
        padded = np.zeros((len(values), row), np.uint8)
        padded[:, : values.shape[1] * values.itemsize] = values.view(np.uint8).reshape(len(values), -1)
        data = base64.b64encode(padded.tobytes()).decode()
        number = len(content["buffers"])
        content["buffers"].append(
            {"byteLength": padded.size, "uri": f"data:application/octet-stream;base64,{data}"}
        )
        content["bufferViews"].append({"buffer": number, "byteLength": padded.size, "byteStride": row})
        content["accessors"].append(
            {
                "bufferView": number,
                "componentType": KINDS[values.dtype.str[1:]],
                "normalized": normalised,
                "type": f"VEC{values.shape[1]}",
                "count": len(values),
            }
        )
        content["meshes"][0]["primitives"][0]["attributes"][name] = len(content["accessors"]) - 1


def with_picture(content, **info):
    data = io.BytesIO()
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(data, "PNG")
    picture = base64.b64encode(data.getvalue()).decode()
    content["images"] = [{"uri": f"data:image/png;base64,{picture}"}]
    content["textures"] = [{"source": 0}]
    content["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **info}}}]
    content["meshes"][0]["primitives"][0]["material"] = 0


@pytest.mark.parametrize(("kind", "largest"), [("i1", 127), ("i2", 32767)])
def test_normalised_integers_are_what_they_stand_for(tmp_path, kind, largest):
    def change(content):
        content["extensionsRequired"] = content["extensionsUsed"] = ["KHR_mesh_quantization"]
        with_picture(content)
        unsigned = np.dtype(kind.replace("i", "u"))
        most = np.iinfo(unsigned).max
        # The least integer of all stands for -1, too.
        with_arrays(
            content,
            POSITION=((np.array(CORNERS) * [1, 1, largest + 1] * [largest, largest, 1]).astype(kind), True),
            NORMAL=(np.array([(0, 0, largest)] * 3).astype(kind), True),
            TEXCOORD_0=(np.array([(0, 0), (most, 0), (0, most)]).astype(unsigned), True),
        )

    (found,) = read_scene(changed(tmp_path / "a.gltf", change)).objects
    np.testing.assert_allclose(found.vertices, CORNERS)
    np.testing.assert_allclose(found.normals, [(0, 0, 1)] * 3)
    # Those of the library count upwards.
    np.testing.assert_allclose(found.uv, [(0, 1), (1, 1), (0, 0)])


def test_other_integers_are_themselves(tmp_path):
    def change(content):
        with_picture(content)
        with_arrays(
            content,
            POSITION=(np.array([(0, 0, 0), (300, 0, 0), (0, 200, 0)], "i2"), False),
            TEXCOORD_0=(np.array([(0, 0), (3, 0), (0, 2)], "u1"), False),
        )

    nodes = [{**CHAIR[0], "scale": [0.01, 0.01, 0.01]}]
    (found,) = read_scene(changed(tmp_path / "a.gltf", change, nodes)).objects
    np.testing.assert_allclose(found.vertices, [(0, 0, 0), (3, 0, 0), (0, 2, 0)])
    np.testing.assert_allclose(found.uv, [(0, 1), (3, 1), (0, -1)])


@pytest.mark.parametrize("kind", ["u1", "u2"])
def test_colours_of_vertices_are_normalised(tmp_path, kind):
    most = np.iinfo(kind).max

    def change(content):
        colours = np.array([(most, 0, 0), (0, most, 0), (0, 0, most // 2)], kind)
        with_arrays(content, COLOR_0=(colours, True))

    (found,) = read_scene(changed(tmp_path / "a.gltf", change)).objects
    # To a step of 8 bits.
    np.testing.assert_allclose(found.colours, np.diag([1, 1, 0.5]), atol=0.5 / 255)


UV = np.array([(0, 0), (1, 0), (0, 1)], "f4")


def uv_of(path, transform, **info):
    """Texture coordinates, as glTF counts them: downwards."""

    def change(content):
        with_picture(content, extensions={"KHR_texture_transform": transform}, **info)
        content["extensionsRequired"] = content["extensionsUsed"] = ["KHR_texture_transform"]
        with_arrays(content, TEXCOORD_0=(UV, False), TEXCOORD_1=(UV + 5, False))

    (found,) = read_scene(changed(path, change)).objects
    return found.uv * [1, -1] + [0, 1]


def test_a_picture_is_moved_as_its_material_says(tmp_path):
    path = tmp_path / "a.gltf"
    np.testing.assert_allclose(uv_of(path, {}), UV)
    np.testing.assert_allclose(
        uv_of(path, {"offset": [0.5, 0], "scale": [0.5, 2]}), [(0.5, 0), (1, 0), (0.5, 2)]
    )
    # The extension's own example: the lower left quadrant of the picture, turned clockwise by 90 degrees.
    turned = uv_of(path, {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]})
    np.testing.assert_allclose(turned, [(0, 1), (0, 0.5), (0.5, 1)], atol=1e-6)
    np.testing.assert_allclose(uv_of(path, {}, texCoord=1), UV + 5)
    np.testing.assert_allclose(uv_of(path, {"texCoord": 0}, texCoord=1), UV)
    with pytest.warns(UserWarning, match="has a texture but no texture coordinates"):
        uv_of(path, {"texCoord": 2})
    with pytest.raises(SceneFileError, match=r"its meshes: KHR_texture_transform .* not finite.*export"):
        uv_of(path, {"offset": [math.inf, 0]})


def test_two_materials_move_the_same_coordinates(tmp_path):
    def change(content):
        with_picture(content)
        with_arrays(content, TEXCOORD_0=(UV, False))
        (first,) = content["meshes"][0]["primitives"]
        (plain,) = content["materials"]
        moved = json.loads(json.dumps(plain))
        moved["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {
            "KHR_texture_transform": {"scale": [3, 3]}
        }
        content["materials"].append(moved)
        content["meshes"][0]["primitives"] += [{**first, "material": 1}, first]

    (found,) = read_scene(changed(tmp_path / "a.gltf", change)).objects
    np.testing.assert_allclose(found.uv[:, 0], [0, 1, 0, 0, 3, 0, 0, 1, 0])


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["FOO_bar"], "requires FOO_bar, an extension of glTF not read here; export the scene again without"),
        (["EXT_meshopt_compression", "KHR_mesh_quantization"], "requires EXT_meshopt_compression, an exten"),
        (["B_b", "A_a"], "requires A_a and B_b, extensions of glTF not read here; .* without them"),
    ],
)
def test_required_extensions_that_are_not_read_are_refused(tmp_path, names, said):
    def change(content):
        content["extensionsRequired"] = content["extensionsUsed"] = names

    path = changed(tmp_path / "a.gltf", change)
    with pytest.raises(SceneFileError, match=rf"a\.gltf {said}"):
        read_scene(path)
    with pytest.raises(ValueError, match=said):
        fj.load_mesh(path)


def test_what_the_picture_lacks_is_said(tmp_path):
    path = tmp_path / "a.gltf"
    used = {"extensionsUsed": ["EXT_mesh_gpu_instancing", "KHR_materials_ior"]}
    with pytest.warns(UserWarning, match=r"a\.gltf uses EXT_mesh_gpu_instancing, which is not read, so that"):
        read_scene(changed(path, lambda content: content.update(used)))
    with pytest.warns(
        UserWarning, match=r"a\.gltf: the skeletons that deform chair are not read.*export them"
    ):
        read_scene(changed(path, lambda content: content["nodes"][0].update(skin=0)))
    targets = {"targets": [{"POSITION": 0}]}
    with pytest.warns(UserWarning, match=r"a\.gltf: the morph targets that deform chair are not read"):
        read_scene(changed(path, lambda content: content["meshes"][0].update(targets, weights=[0.5])))
    with warnings.catch_warnings():
        # At rest they change nothing.
        warnings.simplefilter("error")
        read_scene(changed(path, lambda content: content["meshes"][0].update(targets, weights=[0.0])))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda content: content["nodes"][0].update(translation=[math.inf, 0, 0]),
            "its nodes: node chair has a translation that is not finite.*export the scene again",
        ),
        (
            lambda content: content["nodes"][0].update(extensions={"KHR_lights_punctual": {"light": 7}}),
            "chair has light 7, and the file has 0 lights; export the scene again",
        ),
        (
            lambda content: content["buffers"][0].update(uri="missing.bin"),
            "refers to missing.bin, which does not exist; put it there, or export",
        ),
    ],
    ids=["nowhere", "light", "buffer"],
)
def test_what_is_not_there_is_named(tmp_path, change, said):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(SceneFileError, match=said):
            read_scene(changed(tmp_path / "a.gltf", change))
