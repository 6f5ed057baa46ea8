"""Files with cameras as other programs write them."""

import json
from pathlib import Path
from typing import Any

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
