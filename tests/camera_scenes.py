"""Files with cameras, meshes and lights as other programs write them."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
    startTimeCode = 5
    endTimeCode = 9
)
def Xform "rig"
{
    double3 xformOp:translate.timeSamples = { 5: (10, 0, 0), 9: (90, 0, 0) }
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
    def Camera "witness"
    {
    }
}
"""


def write_gltf(path: Path, nodes: list[dict[str, Any]]) -> Path:
    """A glTF file with one camera, "film", for nodes to refer to."""
    camera = {"name": "film", "type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}
    path.write_text(json.dumps({"asset": {"version": "2.0"}, "nodes": nodes, "cameras": [camera]}))
    return path


def write_usd(path: Path) -> Path:
    """A stage in centimetres with +z up, and two cameras on a rig that moves."""
    path.write_text(STAGE)
    return path


def write_gltf_scene(
    path: Path, nodes: list[dict[str, Any]], lights: list[dict[str, Any]] | None = None
) -> Path:
    """A glTF file whose mesh 0 is the triangle (0, 0, 0), (1, 0, 0), (0, 1, 0), with a camera and lights."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], dtype="<f4").tobytes()
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"name": "card", "primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": len(corners)}],
        "buffers": [
            {
                "byteLength": len(corners),
                "uri": f"data:application/octet-stream;base64,{base64.b64encode(corners).decode()}",
            }
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "extensions": {"KHR_lights_punctual": {"lights": lights or []}},
    }
    path.write_text(json.dumps(content))
    return path


def usd_scene_text(unit: float = 0.01, axis: str = "Z", more: str = "", card: str = "") -> str:
    """A stage with a card 0.4 m wide 1 m before a camera, and lights; sizes are as `unit` and `axis` ask.

    The card, red above and green below by a picture, is 0.1 m farther to the right in every frame; the camera
    rises by 0.02 m.
    """
    m = 1 / unit

    def place(x: float, y: float, z: float) -> str:
        """World metres with +y up in the stage's axes and units."""
        return str(tuple(m * each for each in ((x, -z, y) if axis == "Z" else (x, y, z))))

    side = [(-0.2, -0.2, 0), (0.2, -0.2, 0), (0.2, 0.2, 0), (-0.2, 0.2, 0)]
    moves = ", ".join(f"{k}: {place(0.1 * (k - 3), 0, -1)}" for k in (3, 4, 5))
    rises = ", ".join(f"{k}: {place(0, 0.02 * (k - 3), 0)}" for k in (3, 4, 5))
    turn = "90" if axis == "Z" else "0"
    return f"""#usda 1.0
(
    metersPerUnit = {unit}
    upAxis = "{axis}"
    startTimeCode = 3
    endTimeCode = 5
    framesPerSecond = 12
    timeCodesPerSecond = 12
)
def Xform "World"
{{
    def Xform "card"
    {{
        double3 xformOp:translate.timeSamples = {{ {moves} }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Mesh "card_data" (prepend apiSchemas = ["MaterialBindingAPI"])
        {{
            point3f[] points = [{", ".join(place(*each) for each in side)}]
            int[] faceVertexCounts = [4]
            int[] faceVertexIndices = [0, 1, 2, 3]
            uniform token subdivisionScheme = "none"
            texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")
            rel material:binding = </World/paper>
            {card}
        }}
    }}
    def Mesh "wall"
    {{
        point3f[] points = [{", ".join(place(5 * x, 5 * y, -2) for x, y, _ in side)}]
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 2, 1, 0, 3, 2]
        uniform token orientation = "leftHanded"
        uniform token subdivisionScheme = "none"
        color3f[] primvars:displayColor = [(0.2, 0.4, 0.6)]
    }}
    def Material "paper"
    {{
        token outputs:surface.connect = </World/paper/surface.outputs:surface>
        def Shader "surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/paper/picture.outputs:rgb>
            color3f inputs:emissiveColor = (0.5, 0, 0)
            token outputs:surface
        }}
        def Shader "picture"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @card.png@
            float2 inputs:st.connect = </World/paper/reader.outputs:result>
            float3 outputs:rgb
        }}
        def Shader "reader"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}
    }}
    def Camera "hero"
    {{
        float focalLength = {0.05 * m * 10}
        float horizontalAperture = {0.036 * m * 10}
        float focusDistance = {1.0 * m}
        float fStop = 2
        double3 xformOp:translate.timeSamples = {{ {rises} }}
        float xformOp:rotateX = {turn}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
    }}
    def DistantLight "sun"
    {{
        float inputs:intensity = 3
        float inputs:exposure = 1
        bool inputs:normalize = 1
        float xformOp:rotateX = {turn}
        uniform token[] xformOpOrder = ["xformOp:rotateX"]
    }}
    def SphereLight "bulb"
    {{
        float inputs:intensity = 8
        color3f inputs:color = (1, 0.5, 0)
        float inputs:radius = {0.1 * m}
        double3 xformOp:translate = {place(1, 2, 3)}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def DomeLight "sky"
    {{
        float inputs:intensity = 0.25
    }}
    {more}
}}
"""


def write_usd_scene(folder: Path, **changes: Any) -> Path:
    """`usd_scene_text` as `shot.usda`, with the card's picture beside it."""
    Image.fromarray(np.array([[[255, 0, 0]], [[0, 255, 0]]], dtype=np.uint8)).save(folder / "card.png")
    path = folder / "shot.usda"
    path.write_text(usd_scene_text(**changes))
    return path
