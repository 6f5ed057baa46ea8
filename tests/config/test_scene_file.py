"""Configs whose scene, camera and shot are those of a file."""

import numpy as np
import pytest
from camera_scenes import usd_scene_text, write_gltf_scene, write_usd_scene

from focusjax.config import ConfigError, build_camera, build_lens, build_scene, load_config
from focusjax.shot import build_shot, solve_shot

pytest.importorskip("pxr.Usd", reason="usd-core is not installed")

CONFIG = """
[scene]
file = "shot.usda"
[camera]
resolution = [40, 30]
[[focus]]
object = "card"
sharp = true
"""


@pytest.fixture
def file(tmp_path):
    write_usd_scene(tmp_path)
    path = tmp_path / "a.toml"
    path.write_text(CONFIG)
    return path


def test_the_file_has_the_scene_the_camera_and_the_lens(file):
    config = load_config(file, ["camera.from=hero"])
    scene, camera = build_scene(config), build_camera(config)
    lens = build_lens(config, camera, solved=False)
    assert list(scene.objects) == ["card", "wall"]
    assert len(scene.lights) == 2
    np.testing.assert_allclose(scene.ambient, [0.25] * 3)
    np.testing.assert_allclose(np.asarray(scene.background.colour), [0.25] * 3)
    assert float(camera.focal_length) == pytest.approx(0.05)
    assert float(lens.focus_distance()) == pytest.approx(1.0)
    assert float(lens.f_number(camera)) == pytest.approx(2.0)
    # What the config says goes before, and its own objects and lights are added.
    more = ["scene.background={kind='constant', colour=0.5}", "scene.ambient=0.5", "lens.f_number=4"]
    more += ["scene.lights=[{kind='point', position=[0,0,0]}]", "camera.position=[0,0,1]"]
    config = load_config(file, [*more, "camera.look_at=[0,0,0]", "camera.focal_length_mm=20"])
    scene = build_scene(config)
    assert len(scene.lights) == 3
    np.testing.assert_allclose(scene.ambient, [0.75] * 3)
    np.testing.assert_allclose(np.asarray(scene.background.colour), [0.5] * 3)
    assert float(build_camera(config).position[2]) == 1
    # A lens that is to be solved for needs none of the file's.
    assert config.lens.f_number == 4


def test_its_time_samples_are_a_shot(file):
    config = load_config(file, ["shot={}"])
    assert config.shot.frames == 3
    assert config.shot.fps == 12
    shot = build_shot(config)
    np.testing.assert_allclose([float(each.position[1]) for each in shot.cameras], [0, 0.02, 0.04], atol=1e-7)
    last = shot.scene.at(3)
    card = last.vertices[np.unique(last.faces[list(last.objects["card"])])]
    np.testing.assert_allclose(card.mean(axis=0), [0.2, 0, -1], atol=1e-6)
    solved = solve_shot(shot).solution
    # The card stays in its plane.
    np.testing.assert_allclose([float(solved.at(k)[1].focus_distance()) for k in range(3)], 1.0, rtol=1e-3)
    assert load_config(file, ["shot={frames=2, fps=24}"]).shot.fps == 24
    still = load_config(file, ["shot={camera=[{frame=1, position=[0,0,0]}]}"])
    assert len(still.shot.camera) == 1


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["camera.from=her"], "has no camera 'her'; did you mean 'hero'"),
        (["scene.file=none.usda"], "none.usda: does not exist"),
        (["scene.file=a.toml"], "is no file of scenes with cameras; expected .usd"),
        (["camera.form=hero"], "unknown key camera.form; did you mean from"),
        (["camera.from=3"], "camera.from is 3; expected text in quotes; give the camera's name"),
        (["scene.photo={file='a.jpg', focal_length_px=100}"], "there is no such photograph"),
    ],
)
def test_what_does_not_fit_is_refused(file, changes, said):
    with pytest.raises(ConfigError, match=said):
        load_config(file, changes)


def test_a_camera_needs_a_file(file):
    file.write_text(CONFIG.replace('file = "shot.usda"', "[[scene.objects]]\nfile = 'box.ply'"))
    with pytest.raises(ConfigError, match=r"camera\.from is 'hero', and there is no file to take a camera"):
        load_config(file, ["camera.from=hero"])


def test_a_file_elsewhere_is_refused_by_its_own_key(file):
    away = file.parent / "away"
    away.mkdir()
    text = CONFIG.replace("shot.usda", "../shot.usda")
    for key, said in (("", "scene"), ('file = "../shot.usda"\n', "camera")):
        (away / "a.toml").write_text(text.replace("[camera]\n", f"[camera]\n{key}") + "[shot]\n")
        with pytest.raises(ConfigError, match=rf"a\.toml: {said}\.file is '\.\./shot\.usda', outside"):
            load_config(away / "a.toml")


def test_a_file_without_light_needs_some(file):
    write_gltf_scene(file.parent / "dark.gltf", [{"mesh": 0, "children": [1]}, {"camera": 0}])
    more = ["scene.file=dark.gltf", "lens.f_number=2", "lens.focus_distance_m=1", "focus=[]"]
    with pytest.raises(
        ConfigError, match=r"dark\.gltf', which has no light that is read; add ambient = 0\.3"
    ):
        build_scene(load_config(file, more))
    assert build_scene(load_config(file, [*more, "scene.unlit=true"])).unlit


def test_a_stage_may_not_read_elsewhere(file):
    theirs = file.parent / "theirs"
    theirs.mkdir()
    (theirs / "shot.usda").write_text(usd_scene_text().replace("@card.png@", "@../card.png@"))
    (theirs / "a.toml").write_text(CONFIG)
    with pytest.raises(ConfigError, match=r"refers to .*card\.png, outside the folders that may be read"):
        build_scene(load_config(theirs / "a.toml"))
    assert build_scene(load_config(theirs / "a.toml", root=file.parent)).textures
