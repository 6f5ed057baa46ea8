"""Opacity as files say it, in all their ways, and its look-up against closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from focusjax.scene import SceneObject, load_mesh, make_object, make_scene

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = SQUARE[:, :2]


def half_there() -> Image.Image:
    """Left half 0.2 and hidden red, right half opaque green."""
    pixels = np.zeros((4, 4, 4), dtype=np.uint8)
    pixels[:, :2] = [255, 0, 0, 51]
    pixels[:, :1, 3] = 0
    pixels[:, 2:] = [0, 255, 0, 255]
    return Image.fromarray(pixels)


def saved(path, material) -> None:
    visual = TextureVisuals(uv=UV, material=material)
    trimesh.Trimesh(SQUARE, FACES, visual=visual, process=False).export(path)


def at(item: SceneObject, x: float, y: float, extent: float = 1e-6) -> float:
    """Opacity of the square's point (x, y)."""
    shader = make_scene([item]).opacity()
    upper = y > x
    weights = (1 - y, y - x, x) if upper else (1 - x, x - y, y)
    order = [0, 2, 1] if upper else [0, 1, 2]
    place = jnp.asarray([weights[k] for k in order])
    return float(shader(jnp.asarray(int(upper)), place, jnp.asarray(extent)))


@pytest.mark.parametrize("mode", [None, "OPAQUE", "MASK", "BLEND"])
def test_alpha_modes_of_gltf(tmp_path, mode):
    factor = [1.0, 1.0, 1.0, 0.8]
    saved(
        tmp_path / "a.glb", PBRMaterial(baseColorTexture=half_there(), baseColorFactor=factor, alphaMode=mode)
    )
    item = load_mesh(tmp_path / "a.glb")
    if mode in (None, "OPAQUE"):
        assert make_scene([item]).may_be_seen_through() is None
        # Nothing is hidden, so no colour is filled in.
        np.testing.assert_allclose(item.textures[0][0, 0], [1, 0, 0])
        return
    np.testing.assert_array_equal(make_scene([item]).may_be_seen_through(), [True, True])
    if mode == "MASK":
        assert [at(item, x, 0.5) for x in (0.3, 0.7)] == [0.0, 1.0]
    else:
        np.testing.assert_allclose([at(item, x, 0.6) for x in (0.375, 0.625)], [0.16, 0.8], atol=2e-3)


def test_the_cutoff_applies_to_factor_times_texture(tmp_path):
    def item(cutoff):
        material = PBRMaterial(
            baseColorTexture=half_there(),
            baseColorFactor=[1.0, 1.0, 1.0, 0.8],
            alphaMode="MASK",
            alphaCutoff=cutoff,
        )
        saved(tmp_path / "a.glb", material)
        return load_mesh(tmp_path / "a.glb")

    assert [at(item(0.1), x, 0.6) for x in (0.375, 0.625)] == [1.0, 1.0]
    assert [at(item(0.7), x, 0.6) for x in (0.375, 0.625)] == [0.0, 1.0]
    assert [at(item(0.9), x, 0.6) for x in (0.375, 0.625)] == [0.0, 0.0]


def test_vertex_alpha_of_blending_gltf(tmp_path):
    mesh = trimesh.Trimesh(SQUARE, FACES, process=False)
    visual = TextureVisuals(uv=UV, material=PBRMaterial(alphaMode="BLEND"))
    colours = np.array([[255, 255, 255, a] for a in (0, 255, 255, 0)], dtype=np.uint8)
    visual.vertex_attributes["color"] = colours
    mesh.visual = visual
    mesh.export(tmp_path / "v.glb")
    item = load_mesh(tmp_path / "v.glb")
    np.testing.assert_allclose([at(item, x, 0.5) for x in (0.25, 0.75)], [0.25, 0.75], atol=1e-6)


@pytest.mark.parametrize(
    ("line", "expected"),
    [("d 0.3", 0.3), ("Tr 0.3", 0.7), ("d 0.3\nTr 0.7", 0.3), ("d 1", 1.0), ("Tr 0", 1.0)],
)
def test_dissolve_and_transparency_of_mtl(tmp_path, line, expected):
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in SQUARE), "usemtl glass", "f 1 2 3", "f 1 3 4"]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "a.mtl").write_text(f"newmtl glass\nKd 1 1 1\n{line}\n")
    assert load_mesh(tmp_path / "a.obj").materials[0].opacity == pytest.approx(expected)


def leaf_obj(tmp_path, line: str):
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in SQUARE), *(f"vt {u} {v}" for u, v in UV)]
    lines += ["usemtl leaf", "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "a.mtl").write_text(f"newmtl leaf\nKd 0 1 0\n{line}\n")
    return tmp_path / "a.obj"


def test_opacity_maps_of_mtl(tmp_path):
    Image.fromarray(np.array([[0, 255], [0, 255]], dtype=np.uint8)).save(tmp_path / "m.png")
    item = load_mesh(leaf_obj(tmp_path, "map_d -s 1 1 1 m.png\nd 0.5"))
    np.testing.assert_allclose([at(item, x, 0.6) for x in (0.25, 0.75)], [0.0, 0.5])
    with pytest.warns(UserWarning, match=r"refers to the opacity map absent\.png, which cannot be read"):
        assert make_scene([load_mesh(leaf_obj(tmp_path, "map_d absent.png"))]).may_be_seen_through() is None


def test_the_alpha_channel_of_an_obj_texture_counts_and_hidden_colours_do_not(tmp_path):
    half_there().save(tmp_path / "t.png")
    item = load_mesh(leaf_obj(tmp_path, "map_Kd t.png"))
    np.testing.assert_allclose([at(item, x, 0.6) for x in (0.375, 0.625)], [0.2, 1.0], atol=1e-6)
    np.testing.assert_array_equal(item.opacities[0][0], np.array([0, 51, 255, 255], dtype=np.float32) / 255)


def test_texels_nobody_sees_take_their_neighbours_colour():
    picture = np.zeros((2, 4, 4), dtype=np.float32)
    picture[:, 2:] = [0.0, 1.0, 0.0, 1.0]
    item = make_object("a", SQUARE, FACES, uv=UV, texture=picture)
    np.testing.assert_allclose(item.textures[0], np.broadcast_to([0, 1, 0], (2, 4, 3)))


def test_an_opacity_given_replaces_the_files(tmp_path):
    saved(tmp_path / "a.glb", PBRMaterial(baseColorTexture=half_there(), alphaMode="MASK"))
    assert make_scene([load_mesh(tmp_path / "a.glb", opacity=1.0)]).may_be_seen_through() is None
    glass = load_mesh(tmp_path / "a.glb", opacity=0.25)
    assert at(glass, 0.2, 0.5) == 0.25
    assert glass.textures


def test_materials_nobody_will_see_are_reported(tmp_path):
    with pytest.warns(UserWarning, match=r"material 'leaf' of mesh file .*a\.obj is wholly transparent"):
        item = load_mesh(leaf_obj(tmp_path, "d 0"))
    assert at(item, 0.2, 0.5) == 0.0


def test_textures_without_coordinates_are_reported(tmp_path):
    half_there().save(tmp_path / "t.png")
    path = leaf_obj(tmp_path, "map_Kd t.png")
    path.write_text(
        "\n".join(
            line.replace("/1", "").replace("/2", "").replace("/3", "").replace("/4", "")
            for line in path.read_text().split("\n")
            if not line.startswith("vt")
        )
    )
    with pytest.warns(UserWarning, match=r"a\.obj has a texture but no texture coordinates"):
        item = load_mesh(path)
    np.testing.assert_allclose(item.materials[0].base_colour, [0, 1, 0], atol=1e-6)


@pytest.mark.parametrize("ending", ["glb", "obj"])
def test_pictures_of_unknown_formats_are_reported(tmp_path, ending):
    if ending == "obj":
        (tmp_path / "t.ktx2").write_bytes(b"\xabKTX 20\xbb")
        path = leaf_obj(tmp_path, "map_Kd t.ktx2")
        expected = r"a\.obj refers to t\.ktx2, which is not a readable picture \(png and jpg"
    else:
        path = tmp_path / "a.glb"
        saved(path, PBRMaterial(baseColorTexture=half_there(), baseColorFactor=[0, 255, 0, 255]))
        path.write_bytes(path.read_bytes().replace(b"\x89PNG", b"\x89XXX"))
        expected = r"a\.glb holds a picture of a format that cannot be read"
    with pytest.warns(UserWarning, match=expected):
        item = load_mesh(path)
    assert item.materials[0].texture == -1
    np.testing.assert_allclose(item.materials[0].base_colour, [0, 1, 0], atol=1e-6)


def test_a_mesh_without_area_is_refused(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 1 1\nv 0.1 0.1 0.1\nf 1 2 3\n")
    with pytest.raises(ValueError, match=r"flat\.obj has no area: its triangles \(1\) are lines or points"):
        load_mesh(tmp_path / "flat.obj")


def test_a_cut_is_as_wide_as_the_patch():
    """A ramp cut in its middle: the share of the patch that lies beyond the cut."""
    ramp = np.ones((4, 64, 4), dtype=np.float32)
    ramp[..., 3] = (np.arange(64) + 0.5) / 64
    item = make_object("a", SQUARE, FACES, uv=UV, texture=ramp, cutoff=0.5)
    # The picture has 64 x 4 texels on a square of 1 m: 16 to a metre on average. Half a texel is 1/32 m.
    texel = 1 / 16
    for shift in (-0.4, -0.1, 0.0, 0.2, 0.6):
        expected = np.clip(0.5 + shift / 0.5, 0, 1)
        assert at(item, 0.5 + shift / 64, 0.6, extent=0.5 * texel) == pytest.approx(expected, abs=1e-5)
    # From far away, the mean of what is there and what is not.
    assert at(item, 0.1, 0.6, extent=64.0) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"opacity": 1.5},
            r"opacity of object 'a' is 1\.5; expected a number, 0 \(not there\) to 1 \(opaque\)",
        ),
        ({"opacity": float("nan")}, "opacity of object 'a' is nan"),
        ({"cutoff": -0.1}, r"cutoff of object 'a' is -0\.1"),
        ({"texture": np.ones((2, 2, 2))}, r"has the shape \(2, 2, 2\); expected \[h, w, 3\] or \[h, w, 4\]"),
        ({"texture": np.full((2, 2, 4), 2.0)}, "opacities outside 0 to 1"),
    ],
)
def test_bad_values_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        make_object("a", SQUARE, FACES, uv=UV, **arguments)
