"""A config of two cards, one before the other, which a short shot is made of."""

from pathlib import Path

CONFIG = """
title = "Two cards"
[scene]
unlit = true
background = { kind = "constant", colour = [0.1, 0.1, 0.2] }
objects = [
    { file = "near.ply", name = "near", colour = [0.8, 0.2, 0.1] },
    { file = "far.ply", name = "far" },
]
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
field_of_view_deg = 40
resolution = [33, 24]
[lens]
aperture_radius_mm = 40
[[focus]]
name = "near card"
point = [-0.2, 0, -1]
sharp = true
[[focus]]
object = "far"
samples = 8
blur_px = 1.5
[render]
rays = 4
supersampling = 1
[shot]
frames = 3
fade_frames = 1
formats = ["png", "exr"]
[[shot.camera]]
frame = 1
position = [0, 0, 0]
[[shot.camera]]
frame = 3
position = [0.05, 0, 0]
[[shot.objects]]
name = "far"
keys = [{ frame = 1, translate = [0, 0, 0] }, { frame = 3, translate = [0, 0.2, 0], scale = 1.2 }]
[[shot.wishes]]
name = "near card"
to_frame = 2
[[shot.wishes]]
name = "far"
from_frame = 2
keys = [{ frame = 1, blur = 1.5 }, { frame = 3, blur = 2.5 }]
"""

CARD = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
{0} {1} {4}
{2} {1} {4}
{2} {3} {4}
{0} {3} {4}
3 0 1 2
3 0 2 3
"""


def write_cards(folder: Path) -> Path:
    """The config's file, with its meshes beside it."""
    (folder / "near.ply").write_text(CARD.format(-0.6, -0.3, 0.0, 0.3, -1.0))
    (folder / "far.ply").write_text(CARD.format(-2.0, -2.0, 2.0, 2.0, -4.0))
    path = folder / "cards.toml"
    path.write_text(CONFIG)
    return path
