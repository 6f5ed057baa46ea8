"""A small config with two boxes, which are both `box.ply` beside it."""

from pathlib import Path

import trimesh

CONFIG = """
title = "Two <boxes>"
[scene]
unlit = true
background = {kind = "gradient", bottom = 0.1, horizon = 0.5, top = [0.2, 0.4, 0.9]}
[[scene.objects]]
file = "box.ply"
name = "near box"
translate = [-0.4, 0, -2]
colour = [0.9, 0.3, 0.2]
[[scene.objects]]
file = "box.ply"
name = "far box"
translate = [1.0, 0, -5]
emission = [4, 3, 2]
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
focal_length_mm = 50
resolution = [40, 30]
[lens]
f_number = 2.0
focus_distance_m = 4.0
[[focus]]
name = "box's front"
point = [-0.4, 0, -1.75]
sharp = true
[[focus]]
object = "far box"
blur_px = 3
tolerance_px = 0.5
[solve]
free = ["focus", "f_number"]
f_number_min = 0.2
[render]
rays = 4
"""


def write_boxes(folder: Path) -> Path:
    """The config as `boxes.toml` in `folder`, with its mesh."""
    trimesh.creation.box((0.5, 0.5, 0.5)).export(folder / "box.ply")
    file = folder / "boxes.toml"
    file.write_text(CONFIG)
    return file
