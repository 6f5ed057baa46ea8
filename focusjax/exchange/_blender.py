"""Cameras for Blender: a Python script that makes or updates one, and needs nothing but Blender.

Blender's worlds have +z up, its cameras look along -z, a length of 1 is a metre (as Blender's importers take
it), shifts are in widths of the sensor, and an opening's radius is half the focal length over the f-stop.
Tilt, focal surfaces and blades with round sides take a camera shader, which Cycles knows from Blender 4.5 on.
Source: Blender's manual and Python API.
"""

from pathlib import Path
from typing import Any

from focusjax.exchange._files import distance, number
from focusjax.exchange._osl import blade_rotation, needs_shader, parameters, shader_text
from focusjax.exchange._record import Frame, Record
from focusjax.exchange._usd import Z_UP
from focusjax.io import replace_file

_SCRIPT = '''"""Makes or updates a camera in Blender ({version} or later). Written by focusjax.

Run it in the Text Editor, or with `blender scene.blend --python FILE`. The world's +y becomes +z, up.
"""

import math

import bpy
from mathutils import Matrix

NAME = {name!r}
RESOLUTION = ({width}, {height})
FPS = {fps}
BLADES, BLADE_ROTATION, BLADE_RATIO = {blades}
FRAMES = {{
{frames}
}}
SHADER = {shader}

scene = bpy.context.scene
found = bpy.data.objects.get(NAME)
if found is None or found.type != "CAMERA":
    found = bpy.data.objects.new(NAME, bpy.data.cameras.new(NAME))
    scene.collection.objects.link(found)
camera = found.data
found.animation_data_clear()
camera.animation_data_clear()
found.rotation_mode = "QUATERNION"
scene.camera = found
scene.render.resolution_x, scene.render.resolution_y = RESOLUTION
scene.render.resolution_percentage = 100
scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1
if len(FRAMES) > 1:
    scene.frame_start, scene.frame_end = min(FRAMES), max(FRAMES)
    scene.render.fps = math.ceil(FPS)
    scene.render.fps_base = math.ceil(FPS) / FPS

camera.type = "PERSP"
camera.lens_unit = "MILLIMETERS"
camera.sensor_fit = "HORIZONTAL"
camera.dof.use_dof = all(values["f_stop"] > 0 for values in FRAMES.values())
camera.dof.focus_object = None
camera.dof.aperture_blades = BLADES
camera.dof.aperture_rotation = BLADE_ROTATION
camera.dof.aperture_ratio = BLADE_RATIO
if SHADER is not None:
    scene.render.engine = "CYCLES"
    text = bpy.data.texts.get(NAME + ".osl") or bpy.data.texts.new(NAME + ".osl")
    text.from_string(SHADER)
    camera.type = "CUSTOM"
    camera.custom_mode = "INTERNAL"
    camera.custom_shader = text

before = None
for frame, values in FRAMES.items():
    place, turn, _ = Matrix(values["matrix"]).decompose()
    if before is not None:
        turn.make_compatible(before)
    before = turn
    found.location, found.rotation_quaternion = place, turn
    camera.sensor_width = values["sensor_width"]
    camera.lens = values["lens"]
    camera.shift_x, camera.shift_y = values["shift"]
    camera.dof.focus_distance = values["focus_distance"]
    if values["f_stop"] > 0:
        camera.dof.aperture_fstop = values["f_stop"]
    for key, value in values.get("shader", {{}}).items():
        camera.cycles_custom[key] = value
    if len(FRAMES) > 1:
        for path in ("location", "rotation_quaternion"):
            found.keyframe_insert(path, frame=frame)
        for path in ("lens", "sensor_width", "shift_x", "shift_y"):
            camera.keyframe_insert(path, frame=frame)
        for path in ("focus_distance", "aperture_fstop"):
            camera.dof.keyframe_insert(path, frame=frame)
        for key in values.get("shader", {{}}):
            camera.keyframe_insert(f'cycles_custom["{{key}}"]', frame=frame)
'''


def write_blender(record: Record, path: Path) -> tuple[Path, ...]:
    """Write the script."""
    replace_file(path, blender_script(record))
    return (path,)


def blender_script(record: Record) -> str:
    """The script's text."""
    shader = needs_shader(record)
    blades = (record.opening.blades, blade_rotation(record), record.opening.squeeze)
    frames = (
        f"    {index}: {_values(record, frame, shader)}," for index, frame in enumerate(record.frames, 1)
    )
    return _SCRIPT.format(
        name=record.name,
        version="4.5" if shader else "3.6",
        width=record.width,
        height=record.height,
        fps=number(record.fps),
        blades=f"({blades[0]}, {number(blades[1])}, {number(blades[2])})",
        frames="\n".join(frames),
        shader=f"'''{shader_text(record)}'''" if shader else "None",
    )


def _values(record: Record, frame: Frame, shader: bool) -> dict[str, Any]:
    """What the script sets in a frame, in Blender's units."""
    values: dict[str, Any] = {
        "matrix": (Z_UP @ frame.pose + 0.0).tolist(),
        "lens": 1000.0 * frame.focal_length,
        "sensor_width": 1000.0 * frame.sensor_width,
        "shift": (frame.shift / frame.sensor_width, frame.rise / frame.sensor_width),
        "focus_distance": distance(frame.focus_distance),
        "f_stop": frame.f_number if frame.aperture_radius else 0.0,
    }
    if shader:
        # The shader's place in the frame would be slid once more.
        values |= {"shift": (0.0, 0.0), "shader": parameters(record, frame)}
    return values
