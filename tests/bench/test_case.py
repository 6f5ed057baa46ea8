"""What all methods are given: baked, kept in a file, distinguished by its hash."""

import dataclasses

import numpy as np
import pytest

from focusjax.bench import case_from_config, resized
from focusjax.bench._case import SKY, load_case
from focusjax.config import load_config
from focusjax.geometry import make_camera
from focusjax.lens import Disk, thin_lens


def test_the_scene_is_unlit_and_at_most_white(case):
    assert case.scene.unlit
    assert case.scene.colours.max() == 1.0
    # The ball's sRGB blue of a half in linear light, and the wall, which glows in a red brighter than white.
    found = np.unique(case.scene.colours, axis=0)
    np.testing.assert_allclose(found, [(1.0, 0.0, 0.214), (1.0, 1.0, 0.25)], atol=2e-3)
    np.testing.assert_allclose(case.scene.background.colour, SKY)
    assert isinstance(case.lens.aperture, Disk)
    assert (case.name, case.title, case.max_layers) == ("ball_and_wall", "Ball & <wall>", 3)


def test_another_size_shows_the_same_field(case, config_file):
    full = case_from_config(load_config(config_file))
    assert (full.camera.width, full.camera.height) == (80, 60)
    assert (case.camera.width, case.camera.height) == (32, 24)
    assert float(case.camera.focal_px) / 32 == pytest.approx(float(full.camera.focal_px) / 80)
    np.testing.assert_allclose(case.camera.principal_point, (16, 12))
    risen = make_camera(np.eye(4), width=80, height=60, focal_length=0.05, rise=0.009, shift=-0.0036)
    np.testing.assert_allclose(resized(risen, 40, 40).principal_point, (24, 30))


def test_a_case_comes_back_from_its_file(case, tmp_path):
    case.save(tmp_path / "case.npz")
    again = load_case(tmp_path / "case.npz")
    assert again.digest() == case.digest()
    assert (again.name, again.title, again.max_layers) == (case.name, case.title, case.max_layers)
    far = dataclasses.replace(case, lens=thin_lens(focus_distance=float("inf"), aperture_radius=0.1))
    far.save(tmp_path / "far.npz")
    assert float(load_case(tmp_path / "far.npz").lens.focus_disparity) == 0.0


def test_everything_that_makes_the_picture_is_in_the_hash(case):
    scene, camera = case.scene, case.camera
    colours = scene.colours.copy()
    colours[0, 0] += 0.01
    others = [
        dataclasses.replace(case, scene=dataclasses.replace(scene, colours=colours)),
        dataclasses.replace(case, scene=dataclasses.replace(scene, vertices=scene.vertices + 1e-3)),
        dataclasses.replace(case, scene=dataclasses.replace(scene, faces=scene.faces[:, ::-1])),
        dataclasses.replace(case, camera=dataclasses.replace(camera, width=33)),
        dataclasses.replace(
            case, camera=dataclasses.replace(camera, focal_length=camera.focal_length * 1.01)
        ),
        dataclasses.replace(case, lens=thin_lens(focus_distance=3.0, aperture_radius=0.061)),
    ]
    assert len({case.digest(), *(other.digest() for other in others)}) == 7


@pytest.mark.parametrize(
    "setting",
    [
        "lens.tilt_deg=2",
        "lens.swing_deg=2",
        "camera.rise_mm=2",
        "camera.shift_mm=2",
        "lens.focal_surface={points=[{object='ball'}]}",
    ],
)
def test_other_lenses_are_refused(config_file, tmp_path, setting):
    bare = tmp_path / "bare.toml"
    bare.write_text(config_file.read_text().replace("focus_distance_m = 3.0", ""))
    overrides = [setting] if "surface" in setting else [setting, "lens.focus_distance_m=3.0"]
    key = setting.partition("=")[0]
    with pytest.raises(ValueError, match=f"has {key}, which not every method understands"):
        case_from_config(load_config(bare, overrides))


def test_surfaces_that_may_be_seen_through_are_refused(config_file):
    config = load_config(config_file, ["scene.objects.0.opacity=0.5"])
    with pytest.raises(ValueError, match="may be seen through, which not every method understands"):
        case_from_config(config)
