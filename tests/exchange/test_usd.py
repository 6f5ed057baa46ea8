"""USD's own library reads what is written as it was meant."""

import numpy as np
import pytest
from exchange_cameras import bladed_lens, projected, round_lens, slid_camera, world_points

import focusjax as fj

Usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
from pxr import Gf, UsdGeom  # noqa: E402

Y_TO_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
STAGES = [(1.0, "Y"), (0.01, "Y"), (1.0, "Z"), (0.01, "Z")]


def opened(path):
    stage = Usd.Stage.Open(str(path))
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    assert len(prims) == 1
    return stage, UsdGeom.Camera(prims[0])


@pytest.mark.parametrize(("unit", "axis"), STAGES)
def test_points_are_where_usd_projects_them(tmp_path, unit, axis):
    camera = slid_camera()
    fj.export_camera(camera, bladed_lens(), tmp_path / "c.usda", to="usd", metres_per_unit=unit, up_axis=axis)
    stage, read = opened(tmp_path / "c.usda")
    assert UsdGeom.GetStageMetersPerUnit(stage) == unit
    assert UsdGeom.GetStageUpAxis(stage) == axis
    seen = read.GetCamera(1)
    frustum = seen.frustum
    to_frame = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    points = world_points()
    placed = (points @ Y_TO_Z.T if axis == "Z" else points) / unit
    there = np.array([to_frame.Transform(Gf.Vec3d(*point)) for point in placed])[:, :2]
    pixels = (there * (1, -1) + 1) / 2 * (camera.width, camera.height)
    # Observed 4e-6: apertures and focal length are of single precision.
    np.testing.assert_allclose(pixels, projected(camera, points), atol=1e-4)
    assert seen.focusDistance * unit == pytest.approx(1.3, rel=1e-6)
    # Focal length and apertures are in tenths of a unit, and the opening is focal length over f-stop.
    assert seen.focalLength / 10 * unit / seen.fStop / 2 == pytest.approx(0.05 / 3.6, rel=1e-6)
    assert read.GetPrim().GetAttribute("focusjax:blades").Get() == 5


def test_a_shot_has_a_sample_a_frame(tmp_path):
    distances = (1.0, 1.5, 2.5)
    cameras = [slid_camera(focal_length=0.05 + 0.01 * index) for index in range(3)]
    lenses = [fj.thin_lens(focus_distance=d, aperture_radius=0.01) for d in distances]
    fj.export_camera(cameras, lenses, tmp_path / "c.usda", to="usd", fps=25)
    stage, read = opened(tmp_path / "c.usda")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (1, 3, 25)
    for frame, distance in enumerate(distances, start=1):
        assert read.GetFocusDistanceAttr().Get(frame) == pytest.approx(distance)
        assert read.GetFStopAttr().Get(frame) == pytest.approx((0.04 + 0.01 * frame) / 0.02)
    # What does not change is said once.
    assert read.GetHorizontalApertureAttr().GetNumTimeSamples() == 0


def test_a_pinhole_has_no_f_stop_and_infinity_is_far(tmp_path):
    lens = fj.thin_lens(focus_distance=float("inf"), aperture_radius=0.0)
    fj.export_camera(slid_camera(), lens, tmp_path / "c.usda", to="usd")
    _, read = opened(tmp_path / "c.usda")
    assert read.GetFStopAttr().Get() == 0.0
    assert read.GetFocusDistanceAttr().Get() == 1e6


def test_any_title_makes_a_name(tmp_path):
    fj.export_camera(slid_camera(), round_lens(), tmp_path / "c.usda", to="usd", name='5 "A"\n)')
    _, read = opened(tmp_path / "c.usda")
    assert read.GetPrim().GetName() == "_5__A___"
