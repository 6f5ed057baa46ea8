"""One small case for all tests of the benchmark."""

import pytest
import trimesh

from focusjax.bench import Case, case_from_config
from focusjax.config import load_config

CONFIG = """
title = "Ball & <wall>"
[scene]
ambient = 0.5
background = {kind = "constant", colour = [0.1, 0.2, 0.3]}
[[scene.objects]]
file = "ball.ply"
name = "ball"
translate = [-0.2, 0, -1.5]
colour = [1.0, 0.0, 0.5]
[[scene.objects]]
file = "wall.ply"
name = "wall"
translate = [0.8, 0, -4]
colour = [0.0, 1.0, 0.0]
emission = [5.0, 0.0, 0.25]
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
focal_length_mm = 50
resolution = [80, 60]
[lens]
aperture_radius_mm = 60
focus_distance_m = 3.0
aperture = {shape = "polygon", blades = 5}
[render]
max_layers = 3
"""


@pytest.fixture(scope="session")
def config_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    trimesh.creation.icosphere(subdivisions=2, radius=0.2).export(folder / "ball.ply")
    trimesh.creation.box((1.5, 4.0, 0.1)).export(folder / "wall.ply")
    (folder / "ball_and_wall.toml").write_text(CONFIG)
    return folder / "ball_and_wall.toml"


@pytest.fixture(scope="session")
def case(config_file) -> Case:
    return case_from_config(load_config(config_file), (32, 24))
