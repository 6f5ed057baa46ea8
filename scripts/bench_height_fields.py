"""Lenses from pictures of heights beside the same lens with analytic spheres: how near, and how quick.

A biconvex singlet with spherical sides is traced analytically, and from pictures of its heights in floating
point and in 16 bits, each through the glass and by polynomials; so is one whose sides are a little
cylindrical besides, which is not the same all around its axis. All see one scene with the same rays, in
turns, so that what else the machine does falls on all alike. Reported are medians of the time of all cores,
for pictures and for rays alone, over that of the analytic sphere through the glass, and the PSNR of pictures
against it; of the cylindrical lens, against its own glass.

    python scripts/bench_height_fields.py --rounded --cylindrical --json result.json
"""

import argparse
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from _command_line import make_table, write_json
from _timing import timed_in_turns
from bench_lenses import NEAREST, errors_of, parser_of, scene_of, shown
from jaxtyping import Array, Float
from rich.console import Console
from rich.table import Table

from focusjax.geometry import Camera, make_camera
from focusjax.layers import peel
from focusjax.lens import AbstractLens, FittedLens, PrescriptionLens, fitted_lens, prescription_lens
from focusjax.metrics import psnr
from focusjax.optics import Prescription, find_glass, height_field, height_field_lens, singlet
from focusjax.trace import render

RADIUS, THICKNESS, SEMI_DIAMETER, WIDTH = 50.0, 5.0, 9.0, 24.0
"""Millimetres: of both sides, and the width of their pictures."""
CYLINDER = 4e-4
"""Curvature in 1/mm along x on top of the spheres of the lens that is not the same all around."""


def arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("--f-number", type=float, default=4.0)
    parser.add_argument("--rows", type=int, default=257, help="of the pictures of heights")
    parser.add_argument("--cylindrical", action="store_true", help="the lens that is not round, too")
    parser.add_argument("--rounded", action="store_true", help="heights of 16 bits, too")
    return parser.parse_args()


def of_heights(rows: int, cylinder: float, *, bits: int | None) -> Prescription:
    """The biconvex lens from pictures of its sides, rounded to so many bits if any."""
    y, x = np.meshgrid(*[np.linspace(-WIDTH / 2, WIDTH / 2, rows)] * 2, indexing="ij")
    heights = np.sqrt(RADIUS**2 - x**2 - y**2) - RADIUS - cylinder * x**2 / 2
    scale = float(np.ptp(heights))
    picture, step = (heights - heights.min()) / scale, 0.0
    if bits is not None:
        step = 1.0 / (2**bits - 1)
        picture = np.round(picture / step) * step
    front, back = (
        height_field(picture, width=WIDTH, scale=scale, towards=side, step=step) for side in ("scene", "film")
    )
    glass = find_glass("N-BK7")
    return height_field_lens(front, back, thickness=THICKNESS, glass=glass, semi_diameter=SEMI_DIAMETER)


def lenses_of(options: argparse.Namespace, camera: Camera) -> dict[str, tuple[AbstractLens, str]]:
    """By name, each with the name of the lens whose picture it should have."""
    radii, glass = (RADIUS, -RADIUS), find_glass("N-BK7")
    made = {
        "spheres": singlet(*radii, thickness=THICKNESS, semi_diameter=SEMI_DIAMETER, glass=glass),
        "heights": of_heights(options.rows, 0.0, bits=None),
    }
    if options.rounded:
        made["heights of 16 bits"] = of_heights(options.rows, 0.0, bits=16)
    if options.cylindrical:
        made["cylindrical heights"] = of_heights(options.rows, CYLINDER, bits=None)
    found: dict[str, tuple[AbstractLens, str]] = {}
    for name, prescription in made.items():
        exact: PrescriptionLens = prescription_lens(
            prescription, camera, focus_distance=options.focus, f_number=options.f_number
        )
        like = f"{name if name == 'cylindrical heights' else 'spheres'}, exact"
        found[f"{name}, exact"] = exact, like
        found[f"{name}, fitted"] = (
            fitted_lens(exact, camera, error_px=options.error, nearest=NEAREST),
            like,
        )
    return found


@eqx.filter_jit
def _rays(lens: AbstractLens, camera: Camera, square: Float[Array, "c n 4"]) -> Float[Array, ""]:
    """A number made of all rays of film and lens samples, so that none is left out."""
    frame = jnp.array([camera.width, camera.height], dtype=square.dtype)

    def one(sample: Array) -> Array:
        ray = lens.ray(camera, sample[:2] * frame, lens.pupil_point(sample[2:]))
        return ray.a.sum() + ray.b.sum() + ray.weight

    return jax.lax.map(jax.vmap(one), square).sum()


def measure(options: argparse.Namespace) -> dict[str, dict[str, object]]:
    """Results of each lens by name; times over that of the first, nanoseconds, pixels and decibels."""
    camera = make_camera(np.eye(4), width=options.width, height=options.height, focal_length=0.05)
    scene, lenses = scene_of(options.balls), lenses_of(options, camera)
    first = next(iter(lenses))
    wanted = dict.fromkeys(like for _, like in lenses.values())
    layers = {like: peel(scene, camera, lenses[like][0], supersampling=1) for like in wanted}
    square = jnp.asarray(np.random.default_rng(0).random((64, 1 << 14, 4)), dtype=float)
    runs = {}
    for name, (lens, like) in lenses.items():
        runs[name, "picture"] = functools.partial(render, layers[like], lens, rays=options.rays)
        runs[name, "rays"] = functools.partial(_rays, lens, camera, square)
    found = timed_in_turns(runs, options.repeats)
    results: dict[str, dict[str, object]] = {}
    for name, (lens, like) in lenses.items():
        picture, base, rays, rays_base = (
            found[each, what].cpu_median for what in ("picture", "rays") for each in (name, first)
        )
        count = square.shape[0] * square.shape[1]
        row = {"picture": picture, "times the spheres'": picture / base}
        row |= {"ns a ray": 1e9 * rays / count, "times theirs": rays / rays_base}
        if name != like:
            row["dB from exact"] = psnr(found[name, "picture"].result, found[like, "picture"].result)
        if isinstance(lens, FittedLens):
            row |= errors_of(lens) | {"polynomials": "round" if lens.transfer.is_round else "uneven"}
        results[name] = row
    return results


def table(results: dict[str, dict]) -> Table:
    columns = ("picture", "times the spheres'", "ns a ray", "times theirs", "dB from exact")
    columns = (*columns, "polynomials", "degree", "worst px", "rms px")
    out = make_table("Height fields", "lens", *columns)
    for name, row in results.items():
        out.add_row(name, *(shown(row.get(column, "")) for column in columns))
    return out


def main() -> None:
    options = arguments()
    results = measure(options)
    Console(width=180).print(table(results))
    write_json(options.json, results)


if __name__ == "__main__":
    main()
