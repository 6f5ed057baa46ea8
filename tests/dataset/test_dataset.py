"""Data sets at tiny size: the same bit for bit by any workers, gone on with, and true to their scenes."""

import json
import re
from contextlib import chdir
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from compilations import compilations
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.dataset import Dataset, _picture, _run, load_dataset, load_spec, spec_of
from focusjax.dataset._scenes import draw_camera, draw_scene
from focusjax.layers import load_layers
from focusjax.lens import thin_lens
from focusjax.trace import render_pinhole

SPEC = """
seed = 7
layers = true

[scene]
objects = {uniform = [1, 3]}

[camera]
resolution = [32, 24]

[lens]
f_number = {log_uniform = [0.5, 2]}

[render]
rays = 4
max_layers = 4
"""


def run(spec, out, count, *words):
    words = ["dataset", str(spec), "--out", str(out), "--count", str(count), *words]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    return result, " ".join(result.output.split())


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.*")}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A spec, and five pictures of it by this process, in tasks of two."""
    folder = tmp_path_factory.mktemp("dataset")
    spec = folder / "spec.toml"
    spec.write_text(SPEC)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_run, "GROUP", 2)
        result, said = run(spec, folder / "one", 5)
        assert result.exit_code == 0, result.output
        assert said.startswith("5 pictures Manifest:")
        yield spec, folder / "one"


@pytest.mark.slow
def test_two_processes_make_the_same_bit_for_bit(made, tmp_path):
    spec, one = made
    result, _ = run(spec, tmp_path / "two", 5, "--jobs", "2")
    assert result.exit_code == 0, result.output
    assert contents(tmp_path / "two") == contents(one)


def test_what_is_there_is_never_made_again(made, tmp_path, monkeypatch):
    """Of a folder that was left with a picture missing, one that was cut short, and no manifest."""
    spec, one = made
    before = contents(one)
    out = tmp_path / "out"
    for name, data in before.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_bytes(data)
    (out / "000" / "000003.npz").unlink()
    (out / "000" / ".unfinished-12345678-000003.npz").write_bytes(b"half")
    (out / "manifest.jsonl").unlink()
    numbers = []

    def counted(spec, number, files):
        numbers.append(number)
        return _picture.make_picture(spec, number, files)

    monkeypatch.setattr(_run, "make_picture", counted)
    result, said = run(spec, out, 5, "--resume")
    assert result.exit_code == 0, result.output
    assert "5 pictures, 4 of them before" in said
    assert numbers == [3]
    assert contents(out) == before


def test_all_pictures_share_their_programs(made):
    """Those of five pictures serve the next five, whatever is in them."""
    spec = load_spec(made[0])
    with compilations() as compiled:
        filled = {_picture.make_picture(spec, number).layers.filled for number in range(5, 10)}
    assert compiled == []
    assert len(filled) > 1


def test_depth_and_blur_are_those_of_the_scene(made, monkeypatch):
    """Depth against rays cast at the triangles by Embree; blur against the thin lens's formula."""
    spec, folder = load_spec(made[0]), made[1]
    seen = {}

    def kept(scene, camera):
        seen["scene"], seen["camera"] = scene, camera
        return first_surfaces(scene, camera)

    first_surfaces = _picture.first_surfaces
    monkeypatch.setattr(_picture, "first_surfaces", kept)
    _picture.make_picture(spec, 1)
    scene, camera = seen["scene"], seen["camera"]
    picture = load_dataset(folder)[1]
    pose = np.asarray(camera.world_from_camera)
    y, x = (np.arange(size) + 0.5 for size in (24, 32))
    focal = 32 * 50 / 36
    x, y = (values.ravel() for values in np.meshgrid((x - 16) / focal, (y - 12) / focal))
    ahead = np.stack([x, -y, -np.ones_like(x)], axis=1) @ pose[:3, :3].T
    mesh = trimesh.Trimesh(scene.vertices, scene.faces, process=False)
    _, ray, point = mesh.ray.intersects_id(
        np.broadcast_to(pose[:3, 3], ahead.shape), ahead, multiple_hits=False, return_locations=True
    )
    depth = np.full(len(x), np.inf)
    depth[ray] = -((point - pose[:3, 3]) @ pose[:3, 2])
    assert np.isfinite(depth).all()
    off = np.abs(picture["depth_m"].ravel() / depth - 1.0)
    # Observed 1e-7 but for pixels whose centre is on an edge, of which there are none here.
    assert np.quantile(off, 0.99) < 1e-5
    assert len(set(depth.round(1))) > 5
    f, n, s = (float(picture[name]) for name in ("focal_length_m", "f_number", "focus_distance_m"))
    coc = focal * f / n * (1.0 / s - 1.0 / picture["depth_m"])
    assert picture["coc_px"] == pytest.approx(coc, abs=1e-5)  # observed 2e-6
    # The lens is focused on a pixel of an object.
    assert np.abs(picture["coc_px"]).min() < 1e-5


def test_a_sharp_picture_is_what_the_blurred_one_shows_in_focus(made):
    sizes, apart = [], []
    for picture in load_dataset(made[1]):
        sizes.append(np.abs(picture["coc_px"]).ravel())
        apart.append(np.abs(picture["defocused"] - picture["sharp"]).mean(axis=-1).ravel())
    size, apart = np.concatenate(sizes), np.concatenate(apart)
    # Observed 0.0022 and 0.0210.
    assert apart[size < 0.3].mean() < 0.25 * apart[size > 1.5].mean()


def test_a_data_set_is_read_by_number_and_in_turn(made):
    read = load_dataset(made[1])
    assert isinstance(read[1:3], Dataset)
    assert [int(each["number"]) for each in read[1:3]] == [1, 2]
    assert repr(read) == f"Dataset(5 pictures in {made[1]})"
    shapes = {name: (value.shape, str(value.dtype)) for name, value in read[0].items()}
    assert shapes["defocused"] == shapes["sharp"] == ((24, 32, 3), "float32")
    assert shapes["depth_m"] == shapes["coc_px"] == ((24, 32), "float32")
    lines = [json.loads(line) for line in (made[1] / "manifest.jsonl").read_text().splitlines()]
    assert [line["file"] for line in lines] == [f"000/00000{k}.npz" for k in range(5)]
    assert lines[2]["f_number"] == float(read[2]["f_number"])
    assert len({line["f_number"] for line in lines}) == 5
    layers = load_layers(made[1] / lines[2]["layers"])
    assert np.asarray(render_pinhole(layers)) == pytest.approx(read[2]["sharp"], abs=1e-3)  # observed 2e-4


def test_a_mesh_of_the_folder_is_as_large_as_is_drawn(tmp_path):
    folder = tmp_path / "meshes" / "below"
    folder.mkdir(parents=True)
    trimesh.creation.box((2.0, 8.0, 4.0)).apply_translation((9, 9, 9)).export(folder / "block.ply")
    (tmp_path / "spec.toml").write_text(
        "[scene]\nmeshes = 'meshes'\nkinds = ['mesh']\nobjects = 2\nsize_m = 0.5\n"
        "standing = 1\ndistance_m = 5"
    )
    spec = load_spec(tmp_path / "spec.toml")
    random = np.random.default_rng(0)
    scene = draw_scene(spec, draw_camera(spec, 0.05, random), spec.mesh_files, random)
    for name in ("object 1", "object 2"):
        vertices = scene.vertices[scene.faces[scene.face_range(name)]].reshape(-1, 3)
        # It stands, so that its height is the largest extent.
        assert [vertices[:, 1].min(), vertices[:, 1].max()] == pytest.approx([0.0, 0.5], abs=1e-12)
        assert np.linalg.norm(np.ptp(vertices, axis=0)) < 0.7


def test_a_picture_that_fails_is_said(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "broken.ply").write_text("no mesh")
    spec = tmp_path / "spec.toml"
    spec.write_text("[scene]\nmeshes = 'meshes'\nkinds = ['mesh']\n")
    result, said = run(spec, tmp_path / "out", 2)
    assert result.exit_code == 1
    assert "focusjax: picture 0: mesh file" in said
    assert "(and 1 more of its group)" in said
    assert (tmp_path / "out" / "manifest.jsonl").read_text() == ""


@pytest.mark.parametrize(
    ("text", "words", "sentence"),
    [
        ("", ["--count", "0"], "count is 0; expected the number of pictures, from 1 to 1000000"),
        ("", ["--jobs", "0"], "jobs is 0; expected at least 1 process"),
        ("", ["--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"], "leave out --jobs 2"),
        ("seeds = 1", [], "unknown key seeds; did you mean seed?"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_written(tmp_path, text, words, sentence):
    spec = tmp_path / "spec.toml"
    spec.write_text(text)
    result, said = run(spec, tmp_path / "out", 1, *words)
    assert result.exit_code == 2
    assert sentence in said
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_is_refused(made, tmp_path):
    spec, one = made
    result, said = run(spec, one, 5)
    assert result.exit_code == 2
    assert "already holds '000'; use --resume to go on with a data set there" in said
    changed = tmp_path / "spec.toml"
    changed.write_text(SPEC.replace("log_uniform = [0.5, 2]", "log_uniform = [0.5, 3]"))
    result, said = run(changed, one, 6, "--resume")
    assert result.exit_code == 2
    assert "is of another lens.f_number.log_uniform.1: its pictures and new ones" in said
    result, said = run(spec, tmp_path, 5, "--resume")
    assert result.exit_code == 2
    assert "holds no data set; choose another with --out" in said
    with pytest.raises(ValueError, match="holds no manifest\\.jsonl; expected a folder that"):
        load_dataset(tmp_path)
    (tmp_path / "manifest.jsonl").write_text("{")
    with pytest.raises(ValueError, match="is broken; `focusjax dataset --resume` writes it anew"):
        load_dataset(tmp_path)


def test_programs_have_room_for_the_worst_blur():
    """The margin is enough for the widest lens that is focused as near or as far as may be."""
    spec = spec_of({"camera": {"resolution": [32, 24]}, "lens": {"f_number": 0.7, "focus_distance_m": 0.5}})
    random = np.random.default_rng(0)
    camera = draw_camera(spec, 0.05, random)
    lens = thin_lens(focus_distance=0.5, f_number=0.7, focal_length=float(camera.focal_length))
    needed = float(lens.reach(camera, jnp.asarray(1.0 / spec.scene.wall_m.ends[1])))
    assert _picture.extent(spec).grid.margin >= needed + 2


def test_the_example_learns_blur(capsys, tmp_path):
    """At a size at which it runs, but is too small to learn much."""
    path = Path(__file__).parents[2] / "examples" / "learn_blur.py"
    full = "SIZE, COUNT, SEEN, STEPS = 128, 240, 200, 2000"
    source = path.read_text()
    assert full in source
    with chdir(tmp_path):
        exec(compile(source.replace(full, full[:27] + "32, 4, 3, 20"), path.name, "exec"), {})
    found, constant = (
        float(number) for number in re.findall(r"off by ([0-9.]+) px", capsys.readouterr().out)
    )
    assert 0.0 < found < 10.0
    assert 0.0 < constant < 10.0
