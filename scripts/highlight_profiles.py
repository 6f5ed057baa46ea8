"""Where the light is in the out-of-focus disc of a small lamp, through real glass.

Rays of the film point on the axis are followed to a disparity in front of the focus and to one behind it, and
their light is counted in ten rings of the same area. Told are the innermost (core) and the outermost (rim),
over an even disc, and the spherical aberration W040 of the lens in micrometres.

    python scripts/highlight_profiles.py
    python scripts/highlight_profiles.py --focus 2 --near 0.7 --far 6 --json result.json
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, make_table, write_json
from rich.console import Console

from focusjax.geometry import look_at
from focusjax.lens import AbstractLens, PrescriptionLens, prescription_lens, thin_lens
from focusjax.optics import (
    Conic,
    Prescription,
    air,
    find_glass,
    lens_preset,
    make_prescription,
    seidel_sums,
    singlet,
    sphere,
)

LENGTH, RAYS, RINGS = 0.05, 20_000, 10
CAMERA = look_at((0, 0, 1), (0, 0, 0), width=600, height=400, focal_length=LENGTH)


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--focus", type=float, default=1.0, help="metres")
    parser.add_argument("--near", type=float, default=0.5, help="metres to a lamp in front of the focus")
    parser.add_argument("--far", type=float, default=float("inf"), help="metres to a lamp behind it")
    parser.add_argument("--json", type=Path, help="file for the results")
    return parser.parse_args()


def lenses(focus: float) -> dict[str, AbstractLens]:
    glass = find_glass("N-BK7")
    backwards = singlet(float("inf"), -26.0, thickness=4.0, semi_diameter=9.0, glass=glass)

    def conic(k: float) -> Prescription:
        front = Conic(jnp.asarray(1 / 26.0), jnp.asarray(k))
        return make_prescription([front, sphere(0.0)], [4.0, 0.0], [9.0, 9.0], [glass, air()], stop=0)

    def real(lens: Prescription, f_number: float | None) -> PrescriptionLens:
        return prescription_lens(lens, CAMERA, focus_distance=focus, f_number=f_number)

    return {
        "thin, f/8": thin_lens(focus_distance=focus, focal_length=LENGTH, f_number=8),
        "plano-convex, flat side to the scene, f/8": real(backwards, 8),
        "the other way round, conic -0.58, f/8": real(conic(-0.58), 8),
        "the other way round, conic -3, f/8": real(conic(-3.0), 8),
        "Planar of 1897, f/4.5": real(lens_preset("planar_us583336_f4.5_1897"), None),
        "double Gauss of 1987, f/4": real(lens_preset("gauss_jp62087922_f1.8_1987"), 4),
        "double Gauss of 1987, f/1.8": real(lens_preset("gauss_jp62087922_f1.8_1987"), None),
    }


def rings(lens: AbstractLens, disparity: float) -> np.ndarray:
    """Light per area from the core to the rim, over that of an even disc."""
    shares = jnp.sqrt((jnp.arange(RAYS) + 0.5) / RAYS)
    points = jnp.stack([shares, jnp.zeros(RAYS)], axis=1)
    rays = jax.vmap(lambda point: lens.ray(CAMERA, CAMERA.principal_point, point))(points)
    at = rays.at(jnp.full(RAYS, disparity)) - CAMERA.principal_point
    away, weight = np.linalg.norm(at, axis=1), np.asarray(rays.weight)
    passing = weight > 0.5
    place = (away[passing] / away[passing].max()) ** 2
    light, _ = np.histogram(place, bins=RINGS, range=(0.0, 1.0), weights=weight[passing])
    return light * RINGS / weight[passing].sum()


def main() -> None:
    options = arguments()
    headings = ("lens", "W040, um", "core in front", "rim in front", "core behind", "rim behind")
    table = make_table("Light in discs", *headings)
    results = {}
    for name, lens in lenses(options.focus).items():
        aberration = 0.0
        if isinstance(lens, PrescriptionLens):
            aberration = 1e3 * float(seidel_sums(lens.prescription, field=0.0).wavefront()["W040"])
        front, behind = (rings(lens, 1.0 / distance) for distance in (options.near, options.far))
        results[name] = {"W040_um": aberration, "front": front.tolist(), "behind": behind.tolist()}
        numbers = (aberration, front[0], front[-1], behind[0], behind[-1])
        table.add_row(name, *(f"{number:.2f}" for number in numbers))
    Console().print(table)
    write_json(options.json, results)


if __name__ == "__main__":
    main()
