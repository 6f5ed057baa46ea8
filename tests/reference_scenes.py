"""The scenes of tests/data with the pictures that Mitsuba 3 made of them."""

import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np

from focusjax.geometry import Camera, look_at
from focusjax.lens import ThinLens, thin_lens
from focusjax.scene import Scene, constant_background, make_object, make_scene

DATA = Path(__file__).parent / "data"


@dataclasses.dataclass(frozen=True, eq=False)
class Reference:
    """One scene, its camera, and a converged picture [h, w, 3] per lens."""

    scene: Scene
    camera: Camera
    lenses: dict[str, ThinLens]
    pictures: dict[str, np.ndarray]


@cache
def load_reference(name: str) -> Reference:
    """The reference `name`, read once."""
    about = json.loads((DATA / f"{name}.json").read_text())
    with np.load(DATA / about["arrays"]) as arrays:
        vertices, faces, colours = arrays["vertices"], arrays["faces"], arrays["colors"]
        pictures = {view["array"]: arrays[view["array"]].astype(np.float64) for view in about["views"]}
    surface = make_object("scene", vertices, faces, vertex_colours=colours / 255.0)
    lenses = {
        view["array"]: thin_lens(
            focus_distance=float(view["focus_distance_m"]), aperture_radius=view["aperture_radius_m"]
        )
        for view in about["views"]
    }
    camera = look_at(
        np.array(about["camera"]["eye"]),
        np.array(about["camera"]["look_at"]),
        np.array(about["camera"]["up"]),
        width=about["width"],
        height=about["height"],
        field_of_view=float(np.radians(about["camera"]["fov_x_deg"])),
    )
    scene = make_scene([surface], background=constant_background(np.array(about["background"])), unlit=True)
    return Reference(scene, camera, lenses, pictures)
