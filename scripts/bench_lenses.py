"""How long real lenses take to trace beside thin ones, exactly and by polynomials, and how far these are off.

One scene, one camera, rays enough: each lens peels once, then all are traced in turns, so that what else the
machine does falls on all alike. The first round shows what compiling costs, the medians of those after it
what tracing costs, over that of the thin lens of the same f-number: in seconds by the clock, which want a
quiet machine, and in seconds of all cores, which suffer less from what else runs.

    python scripts/bench_lenses.py --json result.json

With `--fits` it only reports how far polynomials for lenses that come along are off, wide open.

    python scripts/bench_lenses.py --fits
"""

import argparse
import dataclasses
import functools
import time
from pathlib import Path

import jax
import numpy as np
from _command_line import make_parser, make_table, write_json
from _procedural import boulders, wall
from _timing import timed_in_turns
from rich.console import Console
from rich.table import Table

from focusjax.geometry import make_camera
from focusjax.layers import peel
from focusjax.lens import (
    AbstractLens,
    FittedLens,
    PoorFitError,
    PrescriptionLens,
    ThinLens,
    fitted_lens,
    prescription_lens,
    spectral_lens,
    thin_lens,
)
from focusjax.metrics import psnr
from focusjax.optics import find_glass, lens_preset, singlet
from focusjax.scene import Scene, make_object, make_scene
from focusjax.trace import render

NEAREST = 0.8
"""Metres: nothing in the scene is nearer."""

FITTED = (
    ("gauss_jp62087922_f1.8_1987", 0.05, 1.0),
    ("planar_us583336_f4.5_1897", 0.05, 2.0),
    ("cooke_triplet_50mm_f4", 0.05, 2.0),
    ("retrofocus_35mm_f2", 0.024, 0.6),
    ("biogon_us2721499_f4.5_1955", 0.021, 0.6),
    ("gauss_us2673491_f2_1954", 0.05, 1.0),
    ("sonnar_us1998704_f2_1935", 0.085, 2.0),
)
"""Presets, with focal length and focus distance in metres."""


def parser_of(description: str | None) -> argparse.ArgumentParser:
    """What scripts that compare pictures through lenses are asked for."""
    parser = make_parser(description)
    parser.add_argument("--width", type=int, default=800)
    parser.add_argument("--height", type=int, default=600)
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--focus", type=float, default=2.0, help="focus distance in metres")
    parser.add_argument("--error", type=float, default=0.05, help="pixels that a fitted lens may be off")
    parser.add_argument("--balls", type=int, default=60, help="of 5120 triangles each")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", type=Path, help="file for the results")
    return parser


def arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("--double-gauss", type=float, default=2.0, help="f-number")
    parser.add_argument("--singlet", type=float, default=4.0, help="f-number")
    parser.add_argument("--spectral", action="store_true", help="the double Gauss in colours, too")
    parser.add_argument(
        "--fits", action="store_true", help="report the errors of polynomials, and trace nothing"
    )
    return parser.parse_args()


def fits(options: argparse.Namespace) -> dict[str, dict[str, object]]:
    """Errors of the polynomials for each of `FITTED`, from 0.5 m to infinity."""
    results: dict[str, dict[str, object]] = {}
    for name, length, focus in FITTED:
        camera = make_camera(np.eye(4), width=options.width, height=options.height, focal_length=length)
        lens = prescription_lens(lens_preset(name), camera, focus_distance=focus)
        try:
            fitted = fitted_lens(lens, camera, error_px=options.error, nearest=0.5)
        except PoorFitError as error:
            results[name] = {"dB from exact": str(error)}
            continue
        results[name] = errors_of(fitted)
    return results


def errors_of(lens: FittedLens) -> dict[str, object]:
    error = lens.error
    return {
        "degree": lens.transfer.degree,
        "rims": len(lens.rims),
        "worst px": np.asarray(error.worst).tolist(),
        "rms px": np.asarray(error.rms).tolist(),
        "outline px": np.asarray(error.outline).tolist(),
        "light misplaced": float(error.light),
    }


def scene_of(balls: int) -> Scene:
    """Lumpy balls 1 to 6 m away before a wall at 7 m."""
    mesh = boulders(balls)
    painted = mesh.visual.vertex_colors  # pyright: ignore[reportAttributeAccessIssue, reportOptionalMemberAccess]
    colours = np.asarray(painted)[:, :3] / 255.0
    lumps = make_object("balls", mesh.vertices, mesh.faces, vertex_colours=colours)
    objects = [dataclasses.replace(each, vertices=0.5 * each.vertices) for each in (lumps, wall())]
    return make_scene(objects, unlit=True)


def lenses_of(options: argparse.Namespace, camera) -> dict[str, tuple[AbstractLens, str]]:
    """By name, each with the name of the thin lens that it is compared with."""
    gauss, single = options.double_gauss, options.singlet
    length = float(camera.focal_length)

    def thin(f_number: float) -> ThinLens:
        return thin_lens(focus_distance=options.focus, focal_length=length, f_number=f_number)

    def real(prescription, f_number: float) -> PrescriptionLens:
        return prescription_lens(prescription, camera, focus_distance=options.focus, f_number=f_number)

    def fitted(lens):
        return fitted_lens(lens, camera, error_px=options.error, nearest=NEAREST)

    simple = singlet(50.0, -50.0, thickness=5.0, semi_diameter=9.0, glass=find_glass("N-BK7"))
    first, second = f"thin, f/{single:g}", f"thin, f/{gauss:g}"
    exact, double = real(simple, single), real(lens_preset("gauss_jp62087922_f1.8_1987"), gauss)
    found: dict[str, tuple[AbstractLens, str]] = {
        first: (thin(single), first),
        "singlet, exact": (exact, first),
        "singlet, fitted": (fitted(exact), first),
        second: (thin(gauss), second),
        "double Gauss, exact": (double, second),
        "double Gauss, fitted": (fitted(double), second),
    }
    if options.spectral:
        coloured = spectral_lens(double)
        found["double Gauss, colours, exact"] = (coloured, second)
        found["double Gauss, colours, fitted"] = (fitted(coloured), second)
    return found


def measure(options: argparse.Namespace) -> dict[str, dict[str, object]]:
    """Results of each lens by name; seconds, pixels and decibels."""
    camera = make_camera(np.eye(4), width=options.width, height=options.height, focal_length=0.05)
    scene, results = scene_of(options.balls), dict[str, dict[str, object]]()
    lenses = lenses_of(options, camera)
    layers = {}
    for name, (lens, _) in lenses.items():
        start = time.perf_counter()
        layers[name] = peel(scene, camera, lens, supersampling=1)
        jax.block_until_ready(layers[name].cells)
        results[name] = {"peel with compiling": time.perf_counter() - start, "layers": layers[name].filled}
    runs = {
        name: functools.partial(render, layers[name], lens, rays=options.rays)
        for name, (lens, _) in lenses.items()
    }
    traced = timed_in_turns(runs, options.repeats)
    for name, (lens, thin) in lenses.items():
        row, own, base = results[name], traced[name], traced[thin]
        row |= {"trace": own.median, "times the thin lens": own.median / base.median}
        row |= {"compile": own.first - own.median}
        row |= {"of cores": own.cpu_median, "times the thin lens's": own.cpu_median / base.cpu_median}
        exact = name.replace("fitted", "exact")
        if exact != name:
            row["dB from exact"] = psnr(own.result, traced[exact].result)
        if isinstance(lens, FittedLens):
            row |= errors_of(lens)
    return results


def table(results: dict[str, dict]) -> Table:
    columns = ("trace", "times the thin lens", "of cores", "times the thin lens's", "compile", "layers")
    columns = (*columns, "degree", "worst px", "rms px", "outline px", "light misplaced", "dB from exact")
    out = make_table("Lenses", "lens", *columns)
    for name, row in results.items():
        out.add_row(name, *(shown(row.get(column, "")) for column in columns))
    return out


def shown(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(f"{each:.3f}" for each in value)
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main() -> None:
    options = arguments()
    results = fits(options) if options.fits else measure(options)
    Console().print(table(results))
    write_json(options.json, results)


if __name__ == "__main__":
    main()
