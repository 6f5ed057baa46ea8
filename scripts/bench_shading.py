"""What view-dependent layers gain and cost: a polished table and balls through a wide lens.

Pictures with highlights and mirrored surroundings baked as the lens centre sees them, and worked out by
every ray, are scored against a ray cast that shades every ray where it starts.

    python scripts/bench_shading.py --size 320 240 --rays 64
"""

import argparse
import functools

import numpy as np
import trimesh
from _command_line import make_parser
from _timing import timed
from rich.console import Console
from rich.table import Table

from focusjax.baselines import lens_picture
from focusjax.geometry import Camera, look_at
from focusjax.layers import peel
from focusjax.lens import thin_lens
from focusjax.metrics import psnr, ssim
from focusjax.scene import Scene, directional_light, gradient_background, make_object, make_scene
from focusjax.trace import render


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--size", nargs=2, type=int, default=[320, 240], help="width and height in pixels")
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--radius", type=float, default=0.04, help="aperture radius in metres")
    parser.add_argument("--focus", nargs="+", type=float, default=[0.7, 1.0, 3.0], help="metres")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--reference-rays", type=int, default=256)
    return parser.parse_args()


def polished_scene() -> Scene:
    """Three balls on a table that mirror the sky, with highlights of a low sun and a second light."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.12)
    balls = [
        make_object(
            f"ball {number}",
            mesh.vertices,
            mesh.faces,
            colour=colour,
            specular=0.6,
            shininess=120.0,
            reflectance=0.3,
            translate=place,
        )
        for number, (colour, place) in enumerate(
            [
                ((0.7, 0.2, 0.1), (-0.2, -0.03, -0.8)),
                ((0.2, 0.5, 0.2), (0.05, -0.03, -1.2)),
                ((0.2, 0.3, 0.7), (0.45, -0.03, -1.9)),
            ]
        )
    ]
    corners = [(-4.0, -0.15, -0.3), (4.0, -0.15, -0.3), (4.0, -0.15, -5.0), (-4.0, -0.15, -5.0)]
    table = make_object(
        "table",
        corners,
        [(0, 1, 2), (0, 2, 3)],
        colour=(0.4, 0.3, 0.2),
        specular=0.6,
        shininess=300.0,
        reflectance=0.2,
    )
    return make_scene(
        [*balls, table],
        lights=[
            directional_light((-0.12, -0.2, 1.0), (1.6, 1.4, 1.2)),
            directional_light((0.8, -0.7, -0.4), (0.3, 0.35, 0.5)),
        ],
        ambient=0.1,
        background=gradient_background((0.05, 0.04, 0.03), (0.5, 0.4, 0.35), (0.05, 0.1, 0.25)),
    )


def camera_of(options: argparse.Namespace) -> Camera:
    width, height = options.size
    return look_at((0.0, 0.1, 0.0), (0.0, -0.05, -1.0), width=width, height=height, field_of_view=0.75)


def main() -> None:
    options = arguments()
    scene, camera = polished_scene(), camera_of(options)
    table = Table("focus", "layers", "PSNR", "SSIM", "peel s", "render s", "first s", "MB")
    for distance in options.focus:
        lens = thin_lens(focus_distance=distance, aperture_radius=options.radius)
        reference = lens_picture(scene, camera, lens, rays=options.reference_rays)
        for view_dependent in (False, True):
            peeling = timed(
                functools.partial(peel, scene, camera, lens, view_dependent=view_dependent), options.repeats
            )
            layers = peeling.result
            tracing = timed(functools.partial(render, layers, lens, rays=options.rays), options.repeats)
            picture = tracing.result
            table.add_row(
                f"{distance:g} m",
                "view-dependent" if view_dependent else "baked",
                f"{psnr(picture, reference):.1f} dB",
                f"{ssim(picture, reference):.4f}",
                f"{peeling.median:.2f}",
                f"{tracing.median:.2f}",
                f"{tracing.first:.2f}",
                f"{layers.nbytes / 1e6:.0f}",
            )
    console = Console()
    console.print(f"{options.size[0]} x {options.size[1]}, {options.rays} rays per pixel")
    console.print(table)
    assert np.isfinite(np.asarray(picture)).all()


if __name__ == "__main__":
    main()
