"""Aberrations over the field: a chart through lenses that bend it, blur it and fringe it.

Pictures are barrel, pincushion, tangential and sagittal blur, lateral colour, a curved field, and the profile
of a real lens beside the glass that it was computed from. All are traced. Small lights show the shapes of
blur, lines show distortion. gallery.png holds all, sheet.jpg the same with names.

    python scripts/aberration_gallery.py --out out/aberrations
    python scripts/aberration_gallery.py --out out/aberrations --only barrel pincushion --rays 256
"""

import argparse
import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
from _command_line import make_parser
from _shapes import shining
from _sheets import save_sheet

from focusjax.geometry import Camera, look_at
from focusjax.io import save_png
from focusjax.layers import peel
from focusjax.lens import (
    AberratedLens,
    AbstractLens,
    HeightCurve,
    chromatic_lens,
    height_curve,
    lens_profile,
    prescription_lens,
    profiled_lens,
    spectral_lens,
    tabulated_aberrations,
    thin_lens,
)
from focusjax.optics import lens_preset
from focusjax.scene import Scene, constant_background, make_scene
from focusjax.trace import render

WIDTH, HEIGHT, FOCAL = 300, 200, 0.0514
FOCUS = 2.57
"""Metres: the plane of the chart, where the profile was made."""
CORNER = 0.0217


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the pictures")
    parser.add_argument("--only", nargs="+", choices=list(LENSES), default=list(LENSES), help="some lenses")
    parser.add_argument("--rays", type=int, default=64, help="per pixel on the average")
    return parser.parse_args()


def camera() -> Camera:
    return look_at((0, 0, 0), (0, 0, -1), width=WIDTH, height=HEIGHT, focal_length=FOCAL)


def opened(f_number: float = 2.0) -> AbstractLens:
    return thin_lens(focus_distance=FOCUS, focal_length=FOCAL, f_number=f_number)


def table(corner: float, power: int = 2) -> HeightCurve:
    """A table that grows with a power of the height, to so much in the corner."""
    heights = np.linspace(0.0, CORNER, 12)
    return height_curve(heights, corner * (heights / CORNER) ** power)


def of_tables(f_number: float = 2.0, **tables: float) -> AbstractLens:
    curves = {name: table(corner) for name, corner in tables.items()}
    return AberratedLens(opened(f_number), tabulated_aberrations(curves, FOCAL / 4.0))


def through_glass() -> AbstractLens:
    lens = prescription_lens(
        lens_preset("gauss_jp62087922_f1.8_1987"), camera(), focus_distance=FOCUS, f_number=2.0
    )
    return spectral_lens(lens)


LENSES: dict[str, Callable[[], AbstractLens]] = {
    "barrel": lambda: of_tables(16.0, distortion=-0.08),
    "pincushion": lambda: of_tables(16.0, distortion=0.08),
    "tangential blur": lambda: of_tables(tangential=0.35),
    "sagittal blur": lambda: of_tables(sagittal=0.35),
    "lateral colour": lambda: chromatic_lens(opened(16.0), magnification=(1.006, 1.0, 0.994), bands=7),
    "both, corners nearer": lambda: of_tables(sagittal=0.35, tangential=0.35),
    "profile of a double Gauss, f/2": lambda: profiled_lens(opened(), lens_profile("gauss_f1.8"), camera()),
    "its glass, f/2": through_glass,
}


def chart() -> Scene:
    """A grid of lines in the plane in focus, with a small light in each field."""
    half_width, half_height = 0.018 / FOCAL * FOCUS * 1.15, 0.012 / FOCAL * FOCUS * 1.15
    thin, objects = 0.0035, []

    def box(name: str, x0: float, y0: float, x1: float, y1: float, light: float) -> None:
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        points = np.column_stack([corners, np.full(4, -FOCUS)])
        objects.append(shining(name, points, light))

    xs, ys = np.linspace(-half_width, half_width, 15), np.linspace(-half_height, half_height, 11)
    for number, x in enumerate(xs):
        box(f"upright {number}", x - thin, -half_height, x + thin, half_height, 0.55)
    for number, y in enumerate(ys):
        for part, (x0, x1) in enumerate(itertools.pairwise(xs)):
            box(f"level {number}, {part}", x0 + thin, y - thin, x1 - thin, y + thin, 0.55)
    for row, y in enumerate(0.5 * (ys[1:] + ys[:-1])):
        for column, x in enumerate(0.5 * (xs[1:] + xs[:-1])):
            box(f"light {row}, {column}", x - 0.008, y - 0.008, x + 0.008, y + 0.008, 2.5)
    return make_scene(objects, background=constant_background(0.012), unlit=True)


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    scene, pictures = chart(), {}
    for name in options.only:
        lens = LENSES[name]()
        pictures[name] = np.asarray(render(peel(scene, camera(), lens), lens, rays=options.rays))
        print(name, f"mean {pictures[name].mean():.4f}", flush=True)
    save_png(options.out / "gallery.png", np.concatenate(list(pictures.values()), axis=0))
    save_sheet(options.out / "sheet.jpg", pictures, row=(8.4, 2.95), dpi=80, quality=85)


if __name__ == "__main__":
    main()
