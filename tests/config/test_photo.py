"""`[scene.photo]`: the camera it brings, and what it does not go with."""

import numpy as np
import pytest
from depth_photos import disk_scene, gdepth_jpeg, jpeg

from focusjax.config import ConfigError, build_camera, build_scene, load_config

CONFIG = """
[scene.photo]
file = "photo.jpg"
focal_length_35mm = 26
[lens]
f_number = 1.4
focus_distance_m = 1
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "photo.jpg").write_bytes(gdepth_jpeg(*disk_scene()))
    (tmp_path / "plain.jpg").write_bytes(jpeg(disk_scene()[0]))
    return tmp_path


def config(folder, text=CONFIG, *overrides):
    (folder / "run.toml").write_text(text)
    return load_config(folder / "run.toml", overrides)


def test_the_camera_is_that_of_the_photograph(folder):
    found = config(folder)
    camera = build_camera(found)
    assert (camera.width, camera.height) == (48, 36)
    np.testing.assert_allclose(float(camera.focal_length), 0.026, rtol=1e-6)
    np.testing.assert_allclose(float(camera.sensor_width), 0.0432666 * 0.8, rtol=1e-5)
    smaller = build_camera(config(folder, CONFIG, "camera.resolution=[24,18]"))
    assert (smaller.width, smaller.height) == (24, 18)
    np.testing.assert_allclose(2 * float(smaller.focal_px), float(camera.focal_px), rtol=1e-6)


def test_a_smaller_picture_is_sampled_twice(folder):
    assert config(folder).render.supersampling == 1
    assert config(folder, CONFIG, "camera.resolution=[48,36]").render.supersampling == 1
    smaller = config(folder, CONFIG, "camera.resolution=[24,18]", "render.rays=8").render
    assert (smaller.supersampling, smaller.rays) == (2, 8)
    asked = config(folder, CONFIG, "camera.resolution=[24,18]", "render.supersampling=1")
    assert asked.render.supersampling == 1


def test_it_is_prepared_for_the_widest_lens_that_may_come(folder):
    assert config(folder).widest_f_number == 1.4
    wider = config(folder, CONFIG, 'solve.free=["focus","f_number"]', "solve.f_number_min=0.9")
    assert wider.widest_f_number == 0.9
    assert config(folder, CONFIG, "scene.photo.widest_f_number=0.7").widest_f_number == 0.7
    assert "guess" in build_scene(config(folder)).objects


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (("scene.ambient=0.3",), "scene has a photo, which has its own objects and light, and ambient"),
        (("scene.photo.depth_unit=cm",), "scene.photo.depth_unit is"),
        (("scene.photo.file=plain.jpg",), "plain.jpg: there is no depth in this photograph"),
        (("scene.photo.file=none.jpg",), "none.jpg: there is no such photograph"),
        (("scene.photo.depht=1",), "unknown key scene.photo.depht; did you mean depth"),
    ],
)
def test_what_does_not_fit_is_refused(folder, overrides, said):
    with pytest.raises(ConfigError) as caught:
        build_scene(config(folder, CONFIG, *overrides))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_scene_has_objects_or_a_photograph(folder):
    with pytest.raises(ConfigError, match="scene has nothing to see"):
        config(folder, "[scene]\nunlit = true\n" + CONFIG.partition("26\n")[2] + "[camera]\n")
