"""Focal surfaces over the frames of a shot: points that move, appear and disappear, solved over time."""

import dataclasses
import json
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cards_config import write_cards
from compilations import compilations
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.focus import ArgumentError, AtPixel, Blur, FocusPoint, locate, solve_surface_frames
from focusjax.geometry import make_camera
from focusjax.lens import focal_surface, thin_lens
from focusjax.shot import build_shot, solve_shot

# The near card is 1 m away at the left, the far one comes from 4 m to 2 m.
SURFACE = [
    "shot.frames=5",
    "shot.camera=[]",
    "shot.wishes=[]",
    "shot.objects=[{name='far', keys=[{frame=1}, {frame=5, translate=[0, 0, 2]}]}]",
    "lens={aperture_radius_mm=40, focal_surface={points=["
    "{name='card', object='near', triangle=0, barycentric=[0.2, 0.5, 0.3]}, {name='far', object='far'}]}}",
]


@pytest.fixture(scope="module")
def config_file(tmp_path_factory):
    return write_cards(tmp_path_factory.mktemp("surface"))


def test_a_surface_follows_what_moves(config_file):
    """Without wishes it passes through its points in every frame, also through a triangle."""
    shot = build_shot(load_config(config_file, [*SURFACE, "focus=[]"]))
    solution = solve_shot(shot).solution
    # Eased, half of the way is done in the middle.
    for frame, depth in ((0, 4.0), (2, 3.0), (4, 2.0)):
        camera, lens = solution.at(frame)
        for control, distance in ((0, 1.0), (1, depth)):
            place = solution.surface.xy[frame, control]
            exact = solution.surface.focus_disparity[frame, control]
            assert float(exact) == pytest.approx(1 / distance, rel=1e-4)
            # Between corners of pixels.
            focus = lens.thin_lens_at(camera, place).focus_disparity
            assert float(focus) == pytest.approx(1 / distance, abs=0.05)


def test_points_come_and_go_without_a_jump(config_file):
    """The far card's point acts from frame 3 on, and rules more and more from there."""
    timed = "shot.surface=[{name='far', from_frame=3, keys=[{frame=1, blur_px=0}, {frame=5, blur_px=4}]}]"
    changes = [*SURFACE, "focus=[]", timed, "shot.fade_frames=2"]
    surface = solve_shot(build_shot(load_config(config_file, changes))).solution.surface
    rule = np.asarray(surface.weight[:, 1] / surface.weight[4, 1])
    np.testing.assert_allclose(rule[:3], [0, 0, 0.5 * rule[3]], rtol=0.5)
    assert rule[3] > 0.5
    # Wished to be behind the focus by 4 px: the surface is nearer than the card at 2 m, 2 f E = 3.6 px m.
    slope = 2 * (33 / 2 / np.tan(np.radians(20))) * 0.04
    assert float(surface.focus_disparity[4, 1]) == pytest.approx(0.5 + 4 / slope, rel=1e-4)


def solved_frames(depths):
    """A shot of one control point, solved for one wish for something at `depths` in 1/m, and 2 f E."""
    camera = make_camera(jnp.eye(4), width=32, height=24, focal_length=0.05)
    lens = thin_lens(focus_distance=2.0, f_number=4.0, focal_length=0.05)
    wish = FocusPoint(AtPixel(16.5, 12.5), Blur(2.0, signed=True))
    there = locate([wish], camera, disparity_map=jnp.ones((24, 32)))
    points = [dataclasses.replace(there, disparity=jnp.asarray(depth)[None]) for depth in depths]
    count = len(depths)
    surfaces = [focal_surface([(16.5, 12.5)], 0.5)] * count
    found = solve_surface_frames(
        points, [camera] * count, surfaces, [lens] * count, smoothness=3.0, steadiness=0.5
    )
    return found, 2 * float(lens.parallax(camera))


@pytest.mark.parametrize("count", [1, 4, 5])
def test_frames_solved_together_are_the_smoothest_that_meet_the_wishes(count):
    """One control point and one wish: the normal equations by hand, and their derivative."""
    depths = np.array([0.5, 0.9, 0.4, 0.6, 0.7])[:count]

    def solved(depths):
        return solved_frames(depths)[0].surface.focus_disparity[:, 0]

    found, slope = solved_frames(depths)
    bend, pace = np.diff(np.eye(count), n=2, axis=0), np.diff(np.eye(count), n=1, axis=0)
    normal = np.eye(count) + 3 * bend.T @ bend + 0.5 * pace.T @ pace
    expected = np.linalg.solve(normal, slope * depths + 2) / slope
    np.testing.assert_allclose(found.surface.focus_disparity[:, 0], expected, atol=1e-7)
    miss = slope * (expected - depths) - 2
    over_time = 3 * np.sum((bend @ expected) ** 2) + 0.5 * np.sum((pace @ expected) ** 2)
    assert float(found.cost) == pytest.approx(0.5 * np.sum(miss**2) + 0.5 * slope**2 * over_time, rel=1e-6)
    # Observed: 1e-8, which is the damping.
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derivative(solved)(depths), np.linalg.inv(normal), atol=1e-7)


def test_other_lengths_of_a_shot_do_not_compile():
    solved_frames([0.5, 0.9, 0.4, 0.6, 0.7, 0.8])
    with compilations() as compiled:
        found, _ = solved_frames([0.5, 0.9, 0.4, 0.6, 0.7])
    assert found.count == len(found.blur) == len(found.points.weight) == len(found.camera.focal_length) == 5
    assert compiled == []


def test_wishes_bend_a_surface_over_time_and_it_is_rendered_with_the_shutter_open(config_file, tmp_path):
    wishes = (
        "focus=[{name='near', point=[-0.2, 0, -1], sharp=true, tolerance_px=0.5}, {object='far', samples=8,"
    )
    wishes += " blur_px=2, signed=true, tolerance_px=2, name='far'}]"
    changes = [*SURFACE, wishes, "shutter.angle_deg=180", "shot.smoothness=0.1", "shot.formats=['png']"]
    options = [part for change in changes for part in ("--set", change)]
    result = CliRunner().invoke(
        app, ["shot", str(config_file), "--out", str(tmp_path), *options, "--frames", "3"]
    )
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["solver"]["free"] == ["focal_surface"]
    assert report["pictures"]["largest_motion_px"] > 0
    got = {wish["name"]: wish["got_px"] for wish in report["frames"][2]["wishes"]}
    assert abs(got["near"]) < 0.5
    assert 0.5 < got["far"] < 4


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("lens.focal_surface.points.1={object='far', triangle=9, barycentric=[1, 0, 0]}", "has 2 triangles;"),
        ("lens.focal_surface.points.0={triangle=1}", "needs triangle and barycentric together"),
        (
            "shot.surface=[{name='for'}]",
            "surface: lens.focal_surface.points has no 'for'; did you mean",
        ),
        (
            "shot.surface=[{name='far', from_frame=3, to_frame=2}]",
            "shot.surface.0 has from_frame = 3 after to_frame = 2; swap the two",
        ),
        (
            "shot.lens=[{frame=1, focus_distance_m=2}]",
            "of focus_distance_m and a lens.focal_surface",
        ),
    ],
)
def test_what_does_not_fit_is_refused(config_file, override, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        build_shot(load_config(config_file, [*SURFACE, "focus=[]", override]))


def test_a_surface_has_control_points(config_file):
    with pytest.raises(ArgumentError, match="no control points; give at least one"):
        dataclasses.replace(build_shot(load_config(config_file, [*SURFACE, "focus=[]"])).surface, controls=())
