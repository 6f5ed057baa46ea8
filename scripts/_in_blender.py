"""Renders unlit triangles with Cycles through the camera that an exported script makes.

Run by `compare_exports.py` with a Python that has bpy:

    python _in_blender.py camera.py scene.npz picture.exr samples
"""

import runpy
import sys
from pathlib import Path

import bpy
import numpy as np

# The package of the registry keeps what compiles camera shaders where Blender itself looks for it.
sys.path += [str(path) for path in Path(bpy.__file__).parents[3].glob("python/lib/*/site-packages")]


def main() -> None:
    script, mesh, picture, samples = sys.argv[1:]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    with np.load(mesh) as kept:
        vertices, faces, colours, sky = (kept[key] for key in ("vertices", "faces", "colours", "sky"))
    # From +y up to +z up.
    turned = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)
    surface = bpy.data.meshes.new("all")
    surface.from_pydata(turned.tolist(), [], faces.tolist())
    attribute = surface.color_attributes.new("colour", "FLOAT_COLOR", "POINT")
    rgba = np.concatenate([colours, np.ones((len(colours), 1))], axis=1).astype(np.float32)
    attribute.data.foreach_set("color", rgba.ravel())
    material = bpy.data.materials.new("unlit")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    source, light = nodes.new("ShaderNodeVertexColor"), nodes.new("ShaderNodeEmission")
    output = nodes.new("ShaderNodeOutputMaterial")
    source.layer_name = "colour"
    links.new(source.outputs["Color"], light.inputs["Color"])
    links.new(light.outputs["Emission"], output.inputs["Surface"])
    surface.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("all", surface))
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*sky.tolist(), 1.0)

    runpy.run_path(script)

    scene.cycles.samples = int(samples)
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 1.0
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0.0
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)


main()
