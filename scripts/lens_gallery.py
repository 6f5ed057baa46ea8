"""The same scene through a thin lens, a singlet, a double Gauss and Rudolph's Planar, side by side.

All have the camera's focal length and focus on the same thing; each opens as wide as asked, or as it can. A
fisheye of a file may join them, in a picture of its own: rays up to 80 degrees from the axis are taken.

    python scripts/lens_gallery.py --out out/lenses
    python scripts/lens_gallery.py --out out/lenses --fisheye fisheye.zmx
"""

import argparse
from pathlib import Path

import numpy as np
from _command_line import make_parser
from _shapes import shining
from _sheets import save_sheet

from focusjax.geometry import Camera, look_at
from focusjax.layers import peel
from focusjax.lens import (
    AbstractLens,
    PoorFitError,
    fitted_lens,
    prescription_lens,
    spectral_lens,
    thin_lens,
)
from focusjax.optics import Prescription, find_glass, lens_preset, load_lens, singlet
from focusjax.scene import Scene, SceneObject, constant_background, load_mesh, make_object, make_scene
from focusjax.trace import render

FOCUS, F_NUMBER, FOCAL_LENGTH = 1.0, 2.0, 0.05
NEAREST = 0.6
MESHES = Path(__file__).parents[1] / "configs" / "meshes"
LIGHT = 14.0


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for lenses.jpg")
    parser.add_argument("--rays", type=int, default=256, help="per pixel on the average")
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--fisheye", type=Path, help="a lens file; it is scaled to 10 mm")
    return parser.parse_args()


def scene() -> Scene:
    """Spot in focus, a wall of small lights far behind, and a floor of tiles."""
    cow = load_mesh(MESHES / "spot.glb", name="spot", rotate=(0, 150, 0), scale=0.14, translate=(0, 0.02, 0))
    objects = [cow, *tiles()]
    for number, (x, y) in enumerate(
        (x, y) for y in np.linspace(-1.4, 2.4, 9) for x in np.linspace(-3, 3, 13)
    ):
        place = np.array([x, y, -5.0])
        corners = place + 0.012 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
        tint = np.array([(1.0, 0.75, 0.5), (1.0, 1.0, 1.0), (0.6, 0.8, 1.0)])[number % 3]
        objects.append(shining(f"light {number}", corners, LIGHT * tint))
    return make_scene(objects, ambient=0.9, background=constant_background((0.02, 0.022, 0.03)))


def tiles() -> list[SceneObject]:
    """A chequered floor from under the camera to far behind."""
    colours = {"dark": (0.1, 0.09, 0.08), "light": (0.5, 0.46, 0.4)}
    floor = []
    for which, (name, colour) in enumerate(colours.items()):
        cells = [(i, j) for i in range(-16, 16) for j in range(-30, 6) if (i + j) % 2 == which]
        corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        flat = 0.12 * (np.array(cells)[:, None] + corner)
        vertices = np.stack([flat[..., 0], np.full(flat.shape[:2], -0.12), flat[..., 1]], axis=-1)
        faces = 4 * np.arange(len(cells))[:, None, None] + np.array([(0, 2, 1), (0, 3, 2)])
        floor.append(make_object(name, vertices.reshape(-1, 3), faces.reshape(-1, 3), colour=colour))
    return floor


def camera(width: int, focal_length: float = FOCAL_LENGTH) -> Camera:
    return look_at((0, 0.12, FOCUS), (0, 0, 0), width=width, height=width * 2 // 3, focal_length=focal_length)


def real(prescription: Prescription, view: Camera, f_number: float | None) -> AbstractLens:
    """In colours, by polynomials where they are near enough."""
    exact = prescription_lens(prescription, view, focus_distance=FOCUS, f_number=f_number)
    coloured = spectral_lens(exact)
    try:
        return fitted_lens(coloured, view, nearest=NEAREST)
    except PoorFitError as error:
        print(error)
        return coloured


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    view, world = camera(options.width), scene()
    simple = singlet(50.0, -50.0, thickness=6.0, semi_diameter=13.0, glass=find_glass("N-BK7"))
    planar, gauss = lens_preset("planar_us583336_f4.5_1897"), lens_preset("gauss_jp62087922_f1.8_1987")
    lenses: dict[str, tuple[AbstractLens, Camera]] = {
        "thin lens, f/2": (
            thin_lens(focus_distance=FOCUS, focal_length=FOCAL_LENGTH, f_number=F_NUMBER), view
        ),
        "biconvex singlet, f/2": (real(simple, view, F_NUMBER), view),
        "double Gauss, 1987, f/2": (real(gauss, view, F_NUMBER), view),
        "Planar, 1897, f/4.5": (real(planar, view, None), view),
    }  # fmt: skip
    if options.fisheye is not None:
        wide = camera(options.width, 0.010)
        lenses[f"{options.fisheye.stem}, 10 mm"] = (real(load_lens(options.fisheye), wide, None), wide)
    pictures = {}
    for name, (lens, seen_by) in lenses.items():
        layers = peel(world, seen_by, lens, supersampling=1)
        pictures[name] = np.asarray(render(layers, lens, rays=options.rays))
        print(name, flush=True)
    style = {"dpi": 90, "quality": 85, "fontsize": 11, "interpolation": None}
    save_sheet(options.out / "lenses.jpg", pictures, row=(9.6, 3.45), **style)


if __name__ == "__main__":
    main()
