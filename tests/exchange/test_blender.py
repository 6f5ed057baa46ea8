"""The script for Blender says what was solved, in Blender's units; where bpy is, it runs."""

import ast
import importlib.util
import json
import math
import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from exchange_cameras import HEIGHT, WIDTH, bladed_lens, round_lens, slid_camera, turned_lens

import focusjax as fj


def constants(path):
    """What the script's capitals are."""
    tree = ast.parse(path.read_text())
    found = {}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            name = ast.unparse(node.targets[0]).strip("()")
            if name.isupper():
                value = ast.literal_eval(node.value)
                names = name.split(", ")
                found |= dict(zip(names, value if len(names) > 1 else [value], strict=True))
    return found


def test_a_plain_camera_is_in_blenders_units(tmp_path):
    camera = slid_camera()
    fj.export_camera(camera, bladed_lens(), tmp_path / "c.py", to="blender", name='A "quoted" \\ name')
    said = constants(tmp_path / "c.py")
    frame = said["FRAMES"][1]
    assert said["NAME"] == 'A "quoted" \\ name'
    assert said["SHADER"] is None
    assert said["RESOLUTION"] == (WIDTH, HEIGHT)
    assert (frame["lens"], frame["sensor_width"]) == pytest.approx((50.0, 36.0))
    assert frame["f_stop"] == pytest.approx(1.8)
    assert frame["focus_distance"] == pytest.approx(1.3)
    # In widths of the sensor, up and to the right.
    assert frame["shift"] == pytest.approx((4.5 / WIDTH, -2 / WIDTH))
    # +z is up.
    x, y, z = camera.position
    np.testing.assert_allclose(np.array(frame["matrix"])[:3, 3], (x, -z, y))
    assert said["BLADES"] == 5
    # Blender counts from a side's middle, against the clock.
    assert said["BLADE_ROTATION"] == pytest.approx(-0.3 - math.pi / 5)


def ray_by_shader(values, place, pupil):
    """Origin and direction, as the shader's last lines compute them, without the opening's shape."""
    x = values["left"] + (values["right"] - values["left"]) * place[0]
    y = values["bottom"] + (values["top"] - values["bottom"]) * place[1]
    plane = np.array([values["plane_x"], values["plane_y"], values["plane_z"]])
    focus = plane @ (x, y, 1.0)
    across = values["focal_length"] * plane[:2]
    ahead = math.sqrt(1.0 - across @ across)
    lean = across @ pupil
    upright = np.asarray(pupil) - across * lean / (1.0 + ahead)
    q = values["aperture_radius"] * np.array([*upright, -lean])
    return q, np.array([x, y, 1.0]) - focus * q


def test_the_shaders_rays_are_ours(tmp_path):
    """By the shader's formula; the shader itself is compiled by scripts/compare_exports.py."""
    camera, lens = slid_camera(), turned_lens()
    fj.export_camera(camera, lens, tmp_path / "c.py", to="blender")
    said = constants(tmp_path / "c.py")
    values = said["FRAMES"][1]["shader"]
    # The shader sees the frame slid already.
    assert said["FRAMES"][1]["shift"] == (0.0, 0.0)
    for place, pupil in [((0.2, 0.7), (0.3, 0.5)), ((0.9, 0.1), (-0.8, 0.1)), ((0.5, 0.5), (0.0, -0.9))]:
        origin, direction = ray_by_shader(values, place, pupil)
        film = jnp.array([place[0] * WIDTH, (1 - place[1]) * HEIGHT])
        ray = lens.ray(camera, film, jnp.array([pupil[0], -pupil[1]]))
        for depth in (0.5, 3.0):
            there = origin + direction * (depth - origin[2]) / direction[2]
            seen = np.asarray(camera.principal_point) + float(camera.focal_px) / depth * there[:2] * (1, -1)
            np.testing.assert_allclose(seen, np.asarray(ray.a + ray.b / depth), atol=1e-4)


def test_round_blades_and_focal_surfaces_take_the_shader(tmp_path):
    camera = slid_camera()
    thin = round_lens(aperture=fj.polygon(7, roundness=0.5))
    fj.export_camera(camera, thin, tmp_path / "c.py", to="blender")
    assert "float roundness = 0.5;" in constants(tmp_path / "c.py")["SHADER"]
    surface = fj.focal_surface([(10, 20), (50, 20), (30, 50)], [0.5, 1.0, 0.8])
    lens = fj.focal_surface_lens(surface, camera, round_lens())
    fj.export_camera(camera, lens, tmp_path / "c.py", to="blender")
    shader = constants(tmp_path / "c.py")["SHADER"]
    table = np.array(
        json.loads("[" + shader.partition("focus_at[")[2].partition("{")[2].partition("}")[0] + "]")
    )
    columns = int(shader.partition("int columns = ")[2].partition(";")[0])
    table = table.reshape(-1, columns)
    steps = HEIGHT // (table.shape[0] - 1), WIDTH // (table.shape[1] - 1)
    np.testing.assert_allclose(table, np.asarray(lens.focus_disparity)[:: steps[0], :: steps[1]], atol=1e-8)


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="bpy is not installed")
def test_blender_makes_and_updates_the_camera(tmp_path):
    lenses = [round_lens(), round_lens(focus_distance=2.0, f_number=4.0)]
    fj.export_camera([slid_camera()] * 2, lenses, tmp_path / "c.py", to="blender", name="Solved")
    check = (
        "import bpy, json, runpy, sys\n"
        "for _ in range(2): runpy.run_path(sys.argv[1])\n"
        "made = [o for o in bpy.data.objects if o.name.startswith('Solved')]\n"
        "found = []\n"
        "for frame in (1, 2):\n"
        "    bpy.context.scene.frame_set(frame)\n"
        "    dof = made[0].data.dof\n"
        "    found.append([dof.focus_distance, dof.aperture_fstop])\n"
        "print('made', json.dumps([len(made), found]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", check, str(tmp_path / "c.py")], capture_output=True, text=True, check=True
    )
    line = next(line for line in done.stdout.splitlines() if line.startswith("made"))
    count, found = json.loads(line.removeprefix("made "))
    assert count == 1
    np.testing.assert_allclose(found, [[1.3, 1.8], [2.0, 4.0]], rtol=1e-6)
