"""How long a picture of a 600 000-triangle scene takes at 800 x 600, and how right it is.

Load, peel and trace are timed separately: the first call shows what compiling costs, the median of
the calls after it what the work costs. Run it on a quiet machine.

    python scripts/bench_render.py --reference truth.npz --json result.json
    python scripts/bench_render.py --mesh dragon.ply bunny.ply
"""

import argparse
from pathlib import Path

from _command_line import make_parser, make_table, write_json
from _procedural import timed_scene, view
from _timing import timed
from _truth import truth
from rich.console import Console
from rich.table import Table

from focusjax.bench._measure import peak_memory
from focusjax.bench._run import machine
from focusjax.layers import peel
from focusjax.metrics import psnr, ssim
from focusjax.trace import render


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--mesh", nargs="+", type=Path, default=[], help="files instead of the lumpy balls")
    parser.add_argument("--objects", type=int, help="balls (120), or copies of meshes (3 of each)")
    parser.add_argument(
        "--subdivisions", type=int, default=4, help="of the balls: 4 makes 5120 triangles each"
    )
    parser.add_argument("--width", type=int, default=800)
    parser.add_argument("--height", type=int, default=600)
    parser.add_argument("--supersampling", type=int, default=2)
    parser.add_argument("--rays", nargs="+", type=int, default=[16, 64])
    parser.add_argument("--radius", type=float, default=0.05, help="aperture radius in metres")
    parser.add_argument("--focus", type=float, default=5.0, help="focus distance in metres")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--reference", type=Path, help="file that keeps the converged picture")
    parser.add_argument("--reference-samples", type=int, default=1024, help="0 leaves the score out")
    parser.add_argument("--json", type=Path, help="file for the results")
    return parser.parse_args()


def measure(options: argparse.Namespace) -> dict[str, object]:
    """All results by name, times in seconds."""
    about = machine()
    scene, load = timed_scene(options.mesh, options.objects, options.subdivisions)
    camera, lens = view(options.width, options.height, focus=options.focus, radius=options.radius)
    peeled = timed(lambda: peel(scene, camera, lens, supersampling=options.supersampling), options.repeats)
    layers = peeled.result
    traced = {
        rays: timed(lambda n=rays: render(layers, lens, rays=n), options.repeats) for rays in options.rays
    }
    results: dict[str, object] = {
        "machine": about,
        "triangles": len(scene.faces),
        "width": options.width,
        "height": options.height,
        "supersampling": options.supersampling,
        "layers": layers.filled,
        "layers complete": layers.complete,
        "margin": layers.grid.margin / options.supersampling,
        "load": load,
        "peel": peeled.median,
        "compile": sum(each.first - each.median for each in (peeled, *traced.values())),
        "trace": {rays: each.median for rays, each in traced.items()},
        "peak memory MiB": peak_memory(),
    }
    if options.reference_samples > 0:
        reference, maker = truth(options.reference, scene, camera, lens, options.reference_samples)
        results["reference"] = maker
        results["psnr"] = {rays: psnr(each.result, reference) for rays, each in traced.items()}
        results["ssim"] = {rays: ssim(each.result, reference) for rays, each in traced.items()}
    return results


def table(results: dict) -> Table:
    title = f"{results['triangles']} triangles, {results['width']} x {results['height']}"
    out = make_table(title, "what", "value")
    for name in ("load", "peel", "compile"):
        out.add_row(name, f"{results[name]:.2f} s")
    for rays, seconds in results["trace"].items():
        out.add_row(f"trace, {rays} rays", f"{seconds:.2f} s")
    out.add_row("peak memory", f"{results['peak memory MiB']:.0f} MiB")
    complete = "" if results["layers complete"] else " (more were left)"
    out.add_row("layers", f"{results['layers']}{complete}")
    out.add_row("margin", f"{results['margin']:.0f} px")
    for rays, decibels in results.get("psnr", {}).items():
        out.add_row(f"PSNR, {rays} rays", f"{decibels:.2f} dB")
        out.add_row(f"SSIM, {rays} rays", f"{results['ssim'][rays]:.4f}")
    if "reference" in results:
        out.add_row("against", results["reference"])
    for name, value in results["machine"].items():
        out.add_row(name, f"{value:.2f}" if isinstance(value, float) else str(value))
    return out


def main() -> None:
    options = arguments()
    results = measure(options)
    Console().print(table(results))
    write_json(options.json, results)


if __name__ == "__main__":
    main()
