"""Our picture of the shipped scenes beside Mitsuba's, at 800 x 600 with 64 rays per pixel.

Both see the same unlit triangles: textures are baked to vertex colours, highlights limited to white, the
aperture is a disk and the background one colour, so that only lens and visibility are compared. The lens is
the one the config's wishes are solved for. Both are timed in this run, at their second call.

    python scripts/compare_mitsuba.py --references folder
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from _truth import truth
from rich.console import Console
from rich.table import Table

from focusjax.baselines import mitsuba_picture, unlit_scene
from focusjax.bench import case_from_config
from focusjax.config import load_config
from focusjax.layers import peel
from focusjax.metrics import psnr, ssim
from focusjax.trace import render


def second_call(run):
    """The result and the seconds of a call that follows another."""
    jax.block_until_ready(run())
    start = time.perf_counter()
    result = jax.block_until_ready(run())
    return np.asarray(result), time.perf_counter() - start


def compare(path: Path, options: argparse.Namespace) -> dict[str, object]:
    """Scores and seconds for one config."""
    case = case_from_config(load_config(path), (options.width, options.height))
    scene, camera, lens = case.scene, case.camera, case.lens
    layers = peel(
        scene,
        camera,
        lens,
        max_layers=options.layers,
        supersampling=options.supersampling,
        pixel_filter=options.pixel_filter,
    )
    ours, our_seconds = second_call(lambda: render(layers, lens, rays=options.rays))
    unlit = unlit_scene(scene)
    theirs, their_seconds = second_call(
        lambda: mitsuba_picture(unlit, camera, lens, samples=options.rays, pixel_filter=options.pixel_filter)
    )
    name = path.stem if options.pixel_filter == "box" else f"{path.stem} {options.pixel_filter}"
    kept = None if options.references is None else options.references / f"{name}.npz"
    reference, maker = truth(kept, scene, camera, lens, options.samples, options.pixel_filter)
    widest = float(jnp.abs(lens.blur(camera, camera.principal_point, layers.disparity.max())))
    return {
        "scene": path.stem,
        "triangles": len(scene.faces),
        "layers": layers.filled,
        "complete": layers.complete,
        "widest blur px": widest,
        "psnr": psnr(ours, reference),
        "ssim": ssim(ours, reference),
        "seconds": our_seconds,
        "mitsuba psnr": psnr(theirs, reference),
        "mitsuba ssim": ssim(theirs, reference),
        "mitsuba seconds": their_seconds,
        "reference": maker,
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "configs", nargs="*", type=Path, help="those in configs/ with a plain lens by default"
    )
    parser.add_argument("--width", type=int, default=800)
    parser.add_argument("--height", type=int, default=600)
    parser.add_argument("--rays", type=int, default=64, help="per pixel, for both")
    parser.add_argument("--supersampling", type=int, default=2, help="layer samples per pixel and axis")
    parser.add_argument("--layers", type=int, default=24, help="most layers to peel")
    parser.add_argument("--samples", type=int, default=2048, help="per pixel, for the reference")
    parser.add_argument("--references", type=Path, help="folder that keeps the converged pictures")
    parser.add_argument("--pixel-filter", choices=["box", "tent", "gaussian"], default="box")
    parser.add_argument("--json", type=Path, help="file for the results")
    options = parser.parse_args()
    folder = Path(__file__).parent.parent / "configs"
    shipped = [folder / f"{name}.toml" for name in ("bars", "still_life", "town")]
    results = [compare(path, options) for path in options.configs or shipped]
    table = Table(title=f"{options.width} x {options.height}, {options.rays} rays per pixel, unlit")
    for heading in (
        "scene",
        "triangles",
        "layers",
        "widest blur",
        "PSNR",
        "SSIM",
        "s",
        "Mitsuba: PSNR",
        "SSIM",
        "s",
    ):
        table.add_column(heading, justify="left" if heading == "scene" else "right")
    for row in results:
        table.add_row(
            str(row["scene"]),
            str(row["triangles"]),
            f"{row['layers']}{'' if row['complete'] else '+'}",
            f"{row['widest blur px']:.0f} px",
            f"{row['psnr']:.2f}",
            f"{row['ssim']:.4f}",
            f"{row['seconds']:.2f}",
            f"{row['mitsuba psnr']:.2f}",
            f"{row['mitsuba ssim']:.4f}",
            f"{row['mitsuba seconds']:.2f}",
        )
    Console(width=max(120, Console().width)).print(table)
    if options.json is not None:
        options.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
