"""Mesh files of all formats come in as the same triangles, with their colours and transforms."""

import struct

import imageio.v3 as iio
import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from focusjax.scene import load_mesh


def a_tetrahedron() -> trimesh.Trimesh:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype=float)
    return trimesh.Trimesh(vertices, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], process=False)


def a_square() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A unit square in the plane z = 0 whose texture coordinates equal its x and y."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    return vertices, np.array([[0, 1, 2], [0, 2, 3]]), vertices[:, :2]


def four_colours() -> Image.Image:
    """Top row red, green; bottom row blue, white."""
    pixels = [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]]
    return Image.fromarray(np.array(pixels, dtype=np.uint8))


def textured(material) -> trimesh.Trimesh:
    vertices, faces, uv = a_square()
    return trimesh.Trimesh(vertices, faces, visual=TextureVisuals(uv=uv, material=material), process=False)


def corners_of(item) -> np.ndarray:
    """Corner positions of all faces, in an order that does not depend on the file."""
    triangles = item.vertices[item.faces].reshape(len(item.faces), 9)
    return np.sort(triangles.reshape(-1, 3).round(5), axis=0)


@pytest.mark.parametrize("ending", ["glb", "gltf", "obj", "ply", "stl", "off"])
def test_every_format_gives_the_same_triangles(tmp_path, ending):
    mesh = a_tetrahedron()
    path = tmp_path / f"shape.{ending}"
    if ending == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
            (tmp_path / ("shape.gltf" if name == "model.gltf" else name)).write_bytes(data)
    else:
        mesh.export(path)
    item = load_mesh(path)
    assert item.name == "shape"
    assert item.faces.shape == (4, 3)
    np.testing.assert_allclose(corners_of(item), np.sort(mesh.triangles.reshape(-1, 3), axis=0), atol=1e-6)
    # All faces still run counter-clockwise seen from outside.
    a, b, c = (item.vertices[item.faces[:, i]] for i in range(3))
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - mesh.centroid)
    assert (outward > 0).all()
    np.testing.assert_allclose(np.linalg.norm(item.normals, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(item.materials[0].base_colour, 0.8)


def test_scene_graph_is_joined_with_its_transforms(tmp_path):
    scene = trimesh.Scene()
    mesh = a_tetrahedron()
    scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    scene.add_geometry(mesh.copy(), transform=mirror)
    scene.export(tmp_path / "two.glb")
    item = load_mesh(tmp_path / "two.glb")
    assert len(item.faces) == 8
    np.testing.assert_allclose(item.vertices.min(axis=0), [-1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(item.vertices.max(axis=0), [6, 2, 3], atol=1e-6)
    # The mirrored one is turned outside out again: its signed volume stays positive.
    corners = item.vertices[item.faces]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volumes[item.face_material == 0].sum() == pytest.approx(1.0, rel=1e-5)
    assert volumes[item.face_material == 1].sum() == pytest.approx(1.0, rel=1e-5)


def test_placement_scales_then_rotates_then_translates(tmp_path):
    a_tetrahedron().export(tmp_path / "shape.ply")
    item = load_mesh(tmp_path / "shape.ply", translate=(10, 0, 0), rotate=(0, 0, 90), scale=(2, 1, 1))
    # The corner (1, 0, 0) is stretched to (2, 0, 0) and turned to (0, 2, 0).
    assert np.isclose(item.vertices, [10, 2, 0]).all(axis=1).any()
    assert np.isclose(item.vertices, [8, 0, 0]).all(axis=1).any()
    euler = load_mesh(tmp_path / "shape.ply", rotate=(90, 90, 0))
    # About x first: z goes to -y and stays there; then y turns x to -z.
    assert np.isclose(euler.vertices, [0, -3, 0]).all(axis=1).any()
    assert np.isclose(euler.vertices, [0, 0, -1]).all(axis=1).any()
    axis = load_mesh(tmp_path / "shape.ply", rotate=(1, 1, 1, 120))
    np.testing.assert_allclose(corners_of(axis)[-1], [3, 1, 2], atol=1e-5)


def test_mirroring_keeps_normals_outside(tmp_path):
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "ball.ply")
    item = load_mesh(tmp_path / "ball.ply", scale=(-1, 2, 1))
    corners = item.vertices[item.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", flat, corners.mean(axis=1)) > 0).all()
    assert (np.einsum("ij,ij->i", item.normals, item.vertices) > 0).all()


def test_stored_normals_are_used_unless_an_angle_is_given(tmp_path):
    vertices, faces, _ = a_square()
    tilted = np.tile([0.6, 0.0, 0.8], (4, 1))
    trimesh.Trimesh(vertices, faces, vertex_normals=tilted, process=False).export(tmp_path / "s.glb")
    np.testing.assert_allclose(load_mesh(tmp_path / "s.glb").normals, tilted, atol=1e-6)
    np.testing.assert_allclose(
        load_mesh(tmp_path / "s.glb", rotate=(0, 90, 0)).normals, np.tile([0.8, 0, -0.6], (4, 1)), atol=1e-6
    )
    flat = load_mesh(tmp_path / "s.glb", smooth_angle=40.0)
    np.testing.assert_allclose(flat.normals, np.tile([0, 0, 1.0], (4, 1)), atol=1e-6)


@pytest.mark.parametrize("ending", ["glb", "obj"])
def test_texture_stands_upright(tmp_path, ending):
    material = PBRMaterial if ending == "glb" else SimpleMaterial
    image = {"baseColorTexture": four_colours()} if ending == "glb" else {"image": four_colours()}
    textured(material(**image)).export(tmp_path / f"square.{ending}")
    item = load_mesh(tmp_path / f"square.{ending}")
    assert item.materials[0].texture == 0
    np.testing.assert_allclose(item.materials[0].base_colour, 1.0)
    # glTF counts v downwards in the file, OBJ upwards; here v is up, and row 0 of the picture on top.
    top_left = np.isclose(item.vertices, [0, 1, 0], atol=1e-6).all(axis=1)
    np.testing.assert_allclose(item.uv[top_left], [[0, 1]], atol=1e-6)
    np.testing.assert_allclose(item.textures[0][0, 0], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(item.textures[0][1, 0], [0, 0, 1], atol=1e-6)


def test_ply_texture_and_srgb_decoding(tmp_path):
    vertices, faces, uv = a_square()
    rows = [" ".join(map(str, [*v, *t])) for v, t in zip(vertices, uv, strict=True)]
    header = "ply\nformat ascii 1.0\ncomment TextureFile grey.png\nelement vertex 4\n"
    header += "".join(f"property float {axis}\n" for axis in "xyzst")
    header += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    body = "\n".join([*rows, *(f"3 {a} {b} {c}" for a, b, c in faces)])
    (tmp_path / "square.ply").write_text(header + body + "\n")
    iio.imwrite(tmp_path / "grey.png", np.full((4, 4), 128, dtype=np.uint8))
    item = load_mesh(tmp_path / "square.ply")
    # 128 / 255 in sRGB is 0.2158605 in linear light.
    np.testing.assert_allclose(item.textures[0], 0.2158605, atol=1e-6)


def test_missing_texture_falls_back_with_a_warning(tmp_path):
    textured(SimpleMaterial(image=four_colours(), diffuse=[255, 0, 0, 255])).export(tmp_path / "square.obj")
    (picture,) = tmp_path.glob("*.png")
    picture.unlink()
    with pytest.warns(UserWarning, match=rf"refers to {picture.name}, which does not exist"):
        item = load_mesh(tmp_path / "square.obj")
    assert item.materials[0].texture == -1
    np.testing.assert_allclose(item.materials[0].base_colour, [1, 0, 0], atol=1e-6)
    picture.write_bytes(b"not a picture")
    with pytest.warns(UserWarning, match="is not a readable picture"):
        item = load_mesh(tmp_path / "square.obj")
    assert item.materials[0].texture == -1


def test_material_colours_and_emission_of_gltf_are_linear(tmp_path):
    material = PBRMaterial(baseColorFactor=[0.2, 0.4, 1.0, 1.0], emissiveFactor=[0.5, 0.25, 0.0])
    textured(material).export(tmp_path / "square.glb")
    loaded = load_mesh(tmp_path / "square.glb").materials[0]
    # trimesh keeps factors in 8 bits: 0.2 becomes 51 / 255.
    np.testing.assert_allclose(loaded.base_colour, [0.2, 0.4, 1.0], atol=0.5 / 255)
    np.testing.assert_allclose(loaded.emission, [0.5, 0.25, 0.0])


def test_mtl_highlight_and_emission(tmp_path):
    vertices, faces, _ = a_square()
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in vertices), "usemtl shiny"]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "a.mtl").write_text("newmtl shiny\nKd 1 0.5 0\nKs 0.3 0.2 0.1\nNs 50\nKe 3 2 1\nillum 2\n")
    loaded = load_mesh(tmp_path / "a.obj").materials[0]
    np.testing.assert_allclose(loaded.base_colour, [1, 0.214041, 0], atol=2e-3)  # 8 bits in trimesh
    np.testing.assert_allclose(loaded.specular, [0.3, 0.2, 0.1])
    np.testing.assert_allclose(loaded.emission, [3, 2, 1])
    assert loaded.shininess == 50
    (tmp_path / "a.mtl").write_text("newmtl shiny\nKd 1 0.5 0\nKs 0.3 0.2 0.1\nKe spectral a.rfl\n")
    with pytest.warns(UserWarning, match="has Ke"):
        loaded = load_mesh(tmp_path / "a.obj").materials[0]
    np.testing.assert_allclose(loaded.specular, 0.0)


def test_vertex_colours_are_decoded(tmp_path):
    mesh = a_tetrahedron()
    mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile([255, 128, 0, 255], (4, 1)).astype(np.uint8))
    mesh.export(tmp_path / "c.ply")
    item = load_mesh(tmp_path / "c.ply")
    np.testing.assert_allclose(
        item.colours, np.tile([1.0, 0.2158605, 0.0], (len(item.colours), 1)), atol=1e-6
    )
    np.testing.assert_allclose(item.materials[0].base_colour, 1.0)


def test_face_colours_stay_flat(tmp_path):
    mesh = a_tetrahedron()
    colours = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 255]])
    mesh.visual = ColorVisuals(mesh, face_colors=colours.astype(np.uint8))
    mesh.export(tmp_path / "f.ply")
    item = load_mesh(tmp_path / "f.ply")
    per_face = item.colours[item.faces]
    np.testing.assert_allclose(per_face, np.repeat(colours[:, None, :3] / 255, 3, axis=1), atol=1e-6)


def test_colours_beside_unused_texture_coordinates_are_kept(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 3\n"
    header += "".join(f"property float {axis}\n" for axis in "xyzst")
    header += "".join(f"property uchar {colour}\n" for colour in ("red", "green", "blue"))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    body = "0 0 0 0 0 255 0 0\n1 0 0 1 0 255 0 0\n0 1 0 0 1 255 0 0\n3 0 1 2\n"
    (tmp_path / "c.ply").write_text(header + body)
    item = load_mesh(tmp_path / "c.ply")
    np.testing.assert_allclose(item.colours, np.tile([1.0, 0, 0], (3, 1)))
    np.testing.assert_allclose(item.materials[0].base_colour, 1.0)


def test_overrides_replace_what_the_file_says(tmp_path):
    textured(PBRMaterial(baseColorTexture=four_colours())).export(tmp_path / "square.glb")
    item = load_mesh(
        tmp_path / "square.glb",
        name="other",
        colour=(1.0, 0.5, 0.0),
        emission=(20, 10, 5),
        specular=0.3,
        shininess=12,
    )
    loaded = item.materials[0]
    assert item.name == "other"
    assert loaded.texture == -1
    assert loaded.shininess == 12
    np.testing.assert_allclose(loaded.base_colour, [1.0, 0.2140411, 0.0], atol=1e-6)
    np.testing.assert_allclose(loaded.emission, [20, 10, 5])
    np.testing.assert_allclose(loaded.specular, 0.3)


def damaged(tmp_path, kind: str):
    path = tmp_path / "bad.ply"
    mesh = a_tetrahedron()
    if kind == "missing":
        return tmp_path / "absent.ply"
    if kind == "unknown format":
        path = tmp_path / "bad.xyzzy"
        path.write_text("?")
    elif kind == "unreadable":
        path = tmp_path / "bad.glb"
        path.write_bytes(b"glTF" + bytes(40))
    elif kind == "truncated":
        path.write_bytes(mesh.export(file_type="ply")[:-30])
    elif kind == "no faces":
        trimesh.PointCloud(mesh.vertices).export(path)
    elif kind == "empty file":
        path.write_bytes(b"")
    elif kind in ("nan", "infinite"):
        data = bytearray(mesh.export(file_type="ply"))
        start = data.index(b"end_header\n") + len(b"end_header\n")
        data[start : start + 4] = struct.pack("<f", np.nan if kind == "nan" else np.inf)
        path.write_bytes(data)
    elif kind == "ply out of range":
        path.write_text(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
            "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"
        )
    elif kind == "obj out of range":
        path = tmp_path / "bad.obj"
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    elif kind == "off out of range":
        path = tmp_path / "bad.off"
        path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    return path


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("missing", r"mesh file .*absent\.ply does not exist; check the path"),
        ("unknown format", r"unknown format 'xyzzy'; expected glb, gltf, obj, ply, stl or off"),
        ("unreadable", r"bad\.glb cannot be read \(.*is it a complete glb file"),
        ("truncated", r"bad\.ply cannot be read"),
        ("empty file", r"bad\.ply cannot be read"),
        ("no faces", r"bad\.ply has no faces; expected a mesh of triangles"),
        ("nan", r"1 vertices with NaN or infinite coordinates \(the first is vertex 0\)"),
        ("infinite", r"1 vertices with NaN or infinite coordinates"),
        ("ply out of range", r"vertex 7, but its 3 vertices are 0 to 2"),
        ("obj out of range", r"out of range"),
        ("off out of range", r"face index outside the range of its vertices"),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path, kind, message):
    with pytest.raises(ValueError, match=message) as caught:
        load_mesh(damaged(tmp_path, kind))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"scale": 0.0}, r"scale is 0\.0; expected factors other than 0"),
        ({"scale": (1.0, 2.0)}, r"scale is \(1\.0, 2\.0\); expected 1 or 3 finite numbers"),
        ({"translate": (0.0, np.nan, 0.0)}, r"translate is .*; expected 3 finite numbers"),
        ({"rotate": (0.0, 1.0)}, r"rotate is .*; expected 3 or 4 finite numbers"),
        ({"rotate": (0.0, 0.0, 0.0, 30.0)}, r"whose axis is zero"),
        ({"colour": (1.0, 2.0, 0.0)}, r"colour is .*; expected finite values of 0 to 1"),
        ({"colour": (1.0, 0.0)}, r"colour is .*; expected one number or three"),
        ({"emission": -1.0}, r"emission is -1\.0; expected finite values of at least 0"),
        ({"specular": "bright"}, r"specular is 'bright'; expected one number or three"),
        ({"shininess": 0.5}, r"shininess is 0\.5; expected a finite Phong exponent of at least 1"),
        ({"smooth_angle": 200.0}, r"smooth angle is 200\.0 degrees; expected 0 \(facets\) to 180"),
    ],
)
def test_bad_arguments_are_named(tmp_path, arguments, message):
    a_tetrahedron().export(tmp_path / "shape.ply")
    with pytest.raises(ValueError, match=message):
        load_mesh(tmp_path / "shape.ply", **arguments)


def test_text_in_any_encoding_is_read(tmp_path):
    path = tmp_path / "cafe.obj"
    path.write_bytes(b"# caf\xe9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(load_mesh(path).faces) == 1
