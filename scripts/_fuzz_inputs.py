"""What runs with damaged input start from: a small scene with all its files, as they should be."""

from importlib import resources
from pathlib import Path

import numpy as np
import trimesh

from focusjax.io import save_png

CONFIG = """
title = "boxes"
[scene]
ambient = 0.3
background = {kind = "gradient", bottom = 0.1, horizon = 0.5, top = [0.2, 0.4, 0.9]}
[[scene.lights]]
kind = "directional"
direction = [1, -1, -1]
[[scene.objects]]
file = "box.ply"
name = "near"
translate = [-0.4, 0, -2]
colour = [0.9, 0.3, 0.2]
[[scene.objects]]
file = "box.glb"
name = "far"
translate = [1.0, 0, -5]
specular = 0.3
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
focal_length_mm = 50
resolution = [16, 12]
[lens]
f_number = 2.0
focus_distance_m = 4.0
aperture = {shape = "polygon", blades = 6}
[[focus]]
name = "front"
point = [-0.4, 0, -1.75]
sharp = true
[[focus]]
object = "far"
at_least_px = 1
weight = 2
[[focus]]
pixel = [4, 5]
blur_px = 1
[solve]
free = ["focus", "f_number"]
f_number_min = 0.5
[render]
rays = 4
supersampling = 1
"""

CAMERA = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Xform "rig"
{
    double3 xformOp:translate = (10, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Camera "hero"
    {
        float focalLength = 35
        float horizontalAperture = 24
        float focusDistance = 150
        float fStop = 2.8
        double3 xformOp:translate = (0, 0, 200)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""

PROFILE = """
[lens.profile]
file = "lenses.xml"
lens = "One 50mm"
extrapolate = true
"""

FILM = """
[exposure]
light_ev = 9
time = "1/60"
transmittance = 0.9
compensation = -0.5
iso_min = 50
iso_max = 6400
[[exposure.zones]]
box = [2, 2, 8, 6]
stops = 0.5
weight = 2
[film]
curve = "film.csv"
paper = "paper.csv"
black_and_white = false
rms_granularity = 9
kelvin = 5000
"""

SENSOR = """
[exposure]
luminance_cd_m2 = 4000
iso = 200
meter = "centre"
longest_time = "1/30"
shortest_time = "1/4000"
priority = "focus"
[film]
preset = "plain"
white_balance = [2, 1, 1.5]
[film.noise]
full_well = 40000
read_noise = 3
base_iso = 100
"""

SHOT = """
[shot]
frames = 2
fps = 12
smoothness = 50
steadiness = 2
fade_frames = 1
between = "linear"
formats = ["png", "exr"]
[[shot.camera]]
frame = 1
position = [0, 0, 0]
look_at = [0, 0, -1]
[[shot.camera]]
frame = 2
position = [0.1, 0, 0]
[[shot.lens]]
frame = 2
f_number = 2
[[shot.free]]
name = "f_number"
to_frame = 1
[[shot.objects]]
name = "near"
keys = [{frame = 1, translate = [-0.4, 0, -2]}, {frame = 2, translate = [-0.3, 0, -2], scale = 1.1}]
[[shot.wishes]]
name = "front"
from_frame = 1
to_frame = 2
keys = [{frame = 1, weight = 1}, {frame = 2, weight = 2, point = [-0.3, 0, -1.7]}]
"""

AGF = """CC our own glasses
NM OURS-1 1 510640 1.510061 64 0 1 1
CD 2.271 -0.0101 0.0106 0.00021 -8e-6 5e-7
LD 0.35 2.3
NM OURS-2 2 517642 1.516800 64.17 0 1 1
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653
LD 0.3 2.5
NM OURS-5 5 514500 1.514379 50 0 1
CD 1.49 1.2e-2 6.17e-4
LD 0.3 2
"""

GLASSES = ("OURS-1", "OURS-2", "OURS-5")
_ZEMAX = (
    "SURF 0\nDISZ INFINITY\nSURF 1\nCURV 0.02\nSTOP\nDISZ 5\nGLAS NAME 0 0 1.5 40\nDIAM 9\n"
    "SURF 2\nCURV -0.02\nDISZ 45\nDIAM 9\nSURF 3\nDISZ 0\n"
)

_LENSFUN = """<lensdatabase version="1">
<lens><maker>M</maker><model>One 50mm</model><cropfactor>1</cropfactor>
<calibration><distortion model="ptlens" focal="50" a="0.01" b="-0.03" c="0.005"/>
<tca model="poly3" focal="50" vr="1.0002" br="0.0001" vb="0.9996"/>
<vignetting model="pa" focal="50" aperture="2" distance="1000" k1="-0.9" k2="0.5" k3="-0.2"/>
<vignetting model="pa" focal="50" aperture="4" distance="1" k1="-0.3" k2="0.1" k3="-0.05"/>
</calibration></lens>
<lens><model>Zoom 20-70mm</model><cropfactor>1</cropfactor><aspect-ratio>4:3</aspect-ratio>
<calibration><distortion model="poly3" focal="20" k1="-0.02"/>
<distortion model="poly3" focal="70" k1="0.01"/></calibration></lens>
</lensdatabase>
"""


def folder_with_inputs(folder: Path) -> None:
    """Everything that runs start from, as it should be."""
    (folder / "boxes.toml").write_text(CONFIG)
    box = trimesh.creation.box((0.5, 0.5, 0.5))
    for ending in ("ply", "glb", "obj", "stl"):
        box.export(folder / f"box.{ending}")
    rng = np.random.default_rng(5)
    save_png(folder / "photo.png", rng.uniform(0, 1, (12, 16, 3)))
    np.save(folder / "depth.npy", np.repeat([[2.0] * 8 + [4.0] * 8], 12, axis=0))
    for lens in (resources.files("focusjax") / "optics" / "data" / "lenses").iterdir():
        (folder / lens.name).write_bytes(lens.read_bytes())
    films = resources.files("focusjax") / "film" / "data"
    (folder / "film.csv").write_bytes((films / "negative.csv").read_bytes())
    (folder / "paper.csv").write_bytes((films / "paper.csv").read_bytes())
    (folder / "table.csv").write_text("lens.f_number,focus.2.blur_px\n2,1\n4,2\n")
    (folder / "camera.usda").write_text(CAMERA)
    (folder / "lenses.xml").write_text(_LENSFUN)
    (folder / "glasses.agf").write_text(AGF)
    for glass in GLASSES:
        (folder / f"{glass.lower()}.zmx").write_text(_ZEMAX.replace("NAME", glass))
