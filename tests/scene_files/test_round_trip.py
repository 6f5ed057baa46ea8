"""Cameras come back from files as they were exported: poses, frames, focus, f-number, tilt and opening."""

import numpy as np
import pytest
from boxes_config import CONFIG, write_boxes
from exchange_cameras import bladed_lens, projected, slid_camera, turned_lens, world_points

import focusjax as fj
from focusjax.config import build_camera, build_lens, load_config

POSE = "position = [0, 0, 0]\nlook_at = [0, 0, -1]\nfocal_length_mm = 50\nresolution = [40, 30]\n"
LENS = "f_number = 2.0\nfocus_distance_m = 4.0\n"
STAGES = [(1.0, "Y"), (0.01, "Y"), (1.0, "Z"), (0.01, "Z")]


def config_with(folder, camera, lens=""):
    """The boxes, with other `[camera]` and `[lens]` tables."""
    file = write_boxes(folder)
    assert POSE in CONFIG
    assert LENS in CONFIG
    file.write_text(CONFIG.replace(POSE, camera + "\n").replace(LENS, lens + "\n"))
    return file


def built(folder, camera, lens=""):
    config = load_config(config_with(folder, camera, lens))
    made = build_camera(config)
    return made, build_lens(config, made, solved=False)


@pytest.mark.parametrize(("unit", "axis"), STAGES)
def test_usd_keeps_camera_and_lens(tmp_path, unit, axis):
    pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    camera, lens = slid_camera(), bladed_lens()
    fj.export_camera(camera, lens, tmp_path / "c.usda", to="usd", metres_per_unit=unit, up_axis=axis)
    read, through = built(tmp_path, 'file = "c.usda"')
    # Observed 5e-8 m, and 3e-8 relative: USD's lengths are of single precision.
    np.testing.assert_allclose(read.world_from_camera, camera.world_from_camera, atol=1e-6)
    assert (read.width, read.height) == (camera.width, camera.height)
    np.testing.assert_allclose(projected(read, world_points()), projected(camera, world_points()), atol=1e-3)
    assert float(through.focus_distance()) == pytest.approx(1.3, rel=1e-6)
    assert float(through.f_number(read)) == pytest.approx(1.8, rel=1e-6)
    assert through.aperture.blades == 5
    # And out again: the same file, to single precision.
    fj.export_camera(read, through, tmp_path / "d.usda", to="usd", metres_per_unit=unit, up_axis=axis)
    again, first = (fj.read_camera(tmp_path / name) for name in ("d.usda", "c.usda"))
    np.testing.assert_allclose(again.pose, first.pose, atol=1e-6)
    assert again.focus_distance == pytest.approx(first.focus_distance, rel=1e-6)
    assert again.f_number == pytest.approx(first.f_number, rel=1e-6)


def test_gltf_keeps_tilt_and_swing(tmp_path):
    camera, lens = slid_camera(shift=0.0, rise=0.0), turned_lens()
    fj.export_camera(camera, lens, tmp_path / "c.gltf", to="gltf", approximate=True)
    read, through = built(tmp_path, 'file = "c.gltf"')
    # Observed 2e-7.
    np.testing.assert_allclose(read.world_from_camera, camera.world_from_camera, atol=1e-6)
    np.testing.assert_allclose(through.plane, lens.plane, rtol=1e-5, atol=1e-6)
    assert float(through.aperture_radius) == pytest.approx(float(lens.aperture_radius), rel=1e-6)
    assert through.aperture.blades == 5


def test_what_the_config_says_goes_before_the_file(tmp_path):
    fj.export_camera(slid_camera(shift=0.0, rise=0.0), turned_lens(), tmp_path / "c.gltf", to="gltf")
    table = 'file = "c.gltf"\nfield_of_view_deg = 30\nresolution = [20, 10]'
    read, through = built(
        tmp_path, table, "f_number = 5.6\ntilt_deg = 1\nswing_deg = 0\nfocus_distance_m = inf"
    )
    assert (read.width, read.height) == (20, 10)
    assert 2 * np.degrees(np.arctan(0.018 / float(read.focal_length))) == pytest.approx(30, rel=1e-5)
    assert float(through.f_number(read)) == pytest.approx(5.6, rel=1e-5)
    assert float(through.plane[2]) == 0.0


def test_an_infinite_focus_and_a_pinhole_come_back(tmp_path):
    pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    lens = fj.thin_lens(focus_distance=float("inf"), aperture_radius=0.0)
    for name, to in (("c.usda", "usd"), ("c.gltf", "gltf")):
        fj.export_camera(slid_camera(shift=0.0, rise=0.0), lens, tmp_path / name, to=to)
        _, through = built(tmp_path, f'file = "{name}"')
        assert float(through.focus_disparity) == 0.0
        assert float(through.aperture_radius) == 0.0
