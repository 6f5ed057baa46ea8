"""Sessions that begin with meshes, a photograph, or a list of configs."""

import numpy as np
import pytest
import trimesh
from boxes_config import CONFIG, write_boxes
from complaints import complaints_in
from PIL import Image
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, build_camera, build_scene, load_config
from focusjax.studio import EditError
from focusjax.studio._desk import Desk
from focusjax.studio._gallery import Gallery
from focusjax.studio._new_config import open_session


def write_box(path, size):
    trimesh.creation.box(size).export(path)
    return path


@pytest.mark.parametrize("size", [(1.0, 3.0, 0.2), (0.004, 0.001, 0.002)])
def test_a_camera_is_placed_to_see_all_of_a_mesh(tmp_path, size):
    session = open_session([write_box(tmp_path / "a box.ply", size)])
    camera, scene = build_camera(session.config), build_scene(session.config)
    seen = project(camera, scene)
    assert (seen > 0).all()
    assert (seen < np.array([camera.width, camera.height])).all()
    spread = np.ptp(seen, axis=0) / np.array([camera.width, camera.height])
    assert 0.6 < spread.max() < 0.95  # it fills the frame, with some room
    assert session.document.unsaved
    assert not session.document.path.exists()
    session.document.save()
    assert load_config(tmp_path / "a box.toml").scene.objects[0].file == "a box.ply"


def project(camera, scene):
    pose = np.linalg.inv(np.asarray(camera.world_from_camera, dtype=float))
    points = scene.vertices @ pose[:3, :3].T + pose[:3, 3]
    flat = points[:, :2] / -points[:, 2:] * float(camera.focal_px) * [1, -1]
    return flat + np.asarray(camera.principal_point)


def test_meshes_of_several_folders_are_one_config_above_them(tmp_path):
    paths = []
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        paths.append(write_box(tmp_path / folder / "box.stl", (1, 1, 1)))
    (tmp_path / "box.toml").write_text("")
    session = open_session(paths)
    assert session.document.path == tmp_path / "box_2.toml"
    assert [(each.name, each.file) for each in session.config.scene.objects] == [
        ("box 1", "one/box.stl"),
        ("box 2", "two/box.stl"),
    ]


def test_a_photograph_with_depth_has_the_camera_that_took_it(tmp_path):
    Image.fromarray(np.full((40, 1200, 3), 90, np.uint8)).save(tmp_path / "desk.png")
    Image.fromarray(np.full((40, 1200), 2000, np.uint16)).save(tmp_path / "deep.png")
    photo = {"depth": str(tmp_path / "deep.png"), "depth_unit": "mm", "focal_length_35mm": 26.0}
    session = open_session([tmp_path / "desk.png"], photo=photo)
    assert session.config.scene.photo.depth == "deep.png"
    assert session.config.camera.resolution == (1024, 34)
    with pytest.raises(ConfigError, match=r"desk\.png.*focal length"):
        open_session([tmp_path / "desk.png"], photo=photo | {"focal_length_35mm": None})
    with pytest.raises(ConfigError, match=r"deep\.png: nothing says what the values of this depth map mean"):
        open_session([tmp_path / "desk.png"], photo=photo | {"depth_unit": None})


def test_the_command_names_its_options(tmp_path):
    Image.fromarray(np.full((40, 60, 3), 90, np.uint8)).save(tmp_path / "desk.png")
    Image.fromarray(np.full((40, 60), 2000, np.uint16)).save(tmp_path / "deep.png")

    def said(*arguments):
        given = ["studio", str(tmp_path / "desk.png"), "--depth", str(tmp_path / "deep.png"), "--no-open"]
        result = CliRunner().invoke(app, [*given, *arguments])
        assert result.exit_code == 2
        return complaints_in(result.stderr)

    assert "give --focal-length-35mm (mm as" in said("--depth-unit", "mm")
    assert "give --depth-unit as one of m, mm" in said("--focal-length-35mm", "26")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["no.ply"], r"no\.ply: there is no such file"),
        (["notes.txt"], r"notes\.txt: is neither a config"),
        (["bad.ply"], r"bad\.ply"),
        (["bad.jpg"], r"bad\.jpg"),
        (["boxes.toml", "box.ply"], r"box\.ply: cannot be opened together with .*boxes\.toml"),
    ],
)
def test_what_cannot_be_opened_is_named(tmp_path, names, message):
    write_boxes(tmp_path)
    for name in ("bad.ply", "bad.jpg", "notes.txt"):
        (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(ConfigError, match=message):
        open_session([tmp_path / name for name in names])


def test_a_copy_elsewhere_names_its_files_from_there(tmp_path):
    (tmp_path / "in").mkdir()
    session = open_session([write_boxes(tmp_path / "in")])
    (tmp_path / "other").mkdir()
    with pytest.raises(EditError, match=r"may not name box\.ply, which lies outside"):
        session.document.save_as(tmp_path / "other" / "copy.toml")
    session.document.save_as(tmp_path / "copy")
    assert load_config(tmp_path / "copy.toml").scene.objects[0].file == "in/box.ply"
    assert session.config.title == "Two <boxes>"
    with pytest.raises(EditError, match="there is a file of that name"):
        session.document.save_as(tmp_path / "in" / "boxes.toml")


def test_what_was_not_saved_is_there_again(tmp_path):
    path = write_boxes(tmp_path)
    first = open_session([path])
    first.rename(1, "behind")
    first.document.keep()
    again = open_session([path])
    assert again.document.recovered
    assert again.config.focus[1].name == "behind"
    again.undo()
    assert again.document.text == CONFIG
    again.redo()
    again.document.save()
    assert not open_session([path]).document.recovered
    assert [each.name for each in tmp_path.glob(".*")] == []


def test_the_start_page_has_configs_with_thumbnails(tmp_path):
    write_boxes(tmp_path)
    (tmp_path / "bad.toml").write_text("[scene]\nobjcts = 3\n")
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'x'\n")
    gallery = Gallery([tmp_path, tmp_path], cache=tmp_path / "cache")
    gallery.wait()
    assert [each.path.stem for each in gallery.entries] == ["bad", "boxes"]
    assert "objcts" in gallery.entries[0].problem
    assert gallery.thumbnail(0) is None
    assert gallery.thumbnail(1)[:3] == b"\xff\xd8\xff"
    again = Gallery([tmp_path], cache=tmp_path / "cache")
    again.wait()
    assert again.thumbnail(1) == gallery.thumbnail(1)
    assert len(list((tmp_path / "cache").iterdir())) == 1
    desk = Desk(gallery=gallery)
    with pytest.raises(ConfigError, match="is neither"):
        desk.open([tmp_path / "notes"])
    assert desk.studio is None
