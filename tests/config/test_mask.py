"""Masks in configs: an image of the picture's size, white on what is meant."""

import imageio.v3 as iio
import numpy as np
import pytest

from focusjax.config import ConfigError, build_camera, build_focus_points, load_config
from focusjax.focus import OnMask, locate
from focusjax.scene import Scene, make_object, make_scene

CONFIG = """
[scene]
unlit = true
[[scene.objects]]
file = "wall.ply"
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
focal_length_mm = 50
resolution = [64, 48]
[lens]
f_number = 2.8
[[focus]]
mask = "mask.png"
samples = 7
sharp = true
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "mask.toml").write_text(CONFIG)
    return tmp_path / "mask.toml"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene([make_object("wall", np.eye(3), [(0, 1, 2)])], unlit=True)


MEANT = np.zeros((48, 64), dtype=bool)
MEANT[10:20, 30:40] = True


@pytest.mark.parametrize(
    "image",
    [
        np.where(MEANT, 255, 100).astype(np.uint8),
        np.where(MEANT, 60000, 3).astype(np.uint16),
        np.dstack([np.where(MEANT, 255, 0)] * 3 + [np.full(MEANT.shape, 255)]).astype(np.uint8),
    ],
    ids=["grey", "16 bits", "colour and alpha"],
)
def test_white_is_what_is_meant(path, scene, image):
    iio.imwrite(path.parent / "mask.png", image)
    (point,) = build_focus_points(load_config(path), scene)
    assert isinstance(point.where, OnMask)
    np.testing.assert_array_equal(point.where.mask, MEANT)
    assert point.where.samples == 7
    assert point.name == "mask mask.png"
    # The disparity of the surface under it, in the frame of this camera.
    ramp = np.broadcast_to(np.linspace(0.1, 0.9, 64), (48, 64))
    found = locate([point], build_camera(load_config(path)), disparity_map=ramp)
    assert found.xy.shape == (7, 2)
    x, y = np.asarray(found.xy).T
    assert ((x > 30) & (x < 40) & (y > 10) & (y < 20)).all()
    np.testing.assert_allclose(found.disparity, np.interp(x, [0.5, 63.5], [0.1, 0.9]))
    np.testing.assert_allclose(found.weight.sum(), 1.0)


def test_what_is_no_mask_is_refused(path, scene):
    config = load_config(path)
    with pytest.raises(ConfigError, match=r"focus\.0\.mask is .*mask\.png, which does not exist; check the"):
        build_focus_points(config, scene)
    (path.parent / "mask.png").write_text("no image")
    with pytest.raises(ConfigError, match=r"focus\.0\.mask is .*mask\.png, which is no image that can be"):
        build_focus_points(config, scene)


def test_a_mask_of_another_size_is_refused(path, scene):
    iio.imwrite(path.parent / "mask.png", np.full((4, 5), 255, dtype=np.uint8))
    (point,) = build_focus_points(load_config(path), scene)
    with pytest.raises(ValueError, match=r"has a mask of shape \(4, 5\); expected one value per pixel"):
        locate([point], build_camera(load_config(path)), disparity_map=np.ones((48, 64)))
