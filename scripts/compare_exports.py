"""Exported cameras rendered by Mitsuba and Blender beside our own pictures, with an unlit scene.

Every program sees the same triangles with colours at their vertices, through the camera that
`focusjax export CONFIG` writes. Mitsuba's camera has a disk for an opening, so that its file is an
approximation where the config's lens has blades. Blender is the package bpy of the registry, or Blender's own
Python, in an environment of its own:

    python scripts/compare_exports.py --to mitsuba
    python scripts/compare_exports.py --to blender --python /path/to/python/with/bpy configs/tilted_row.toml
"""

import argparse
import dataclasses
import subprocess
import tempfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from _command_line import make_parser
from rich.console import Console
from rich.table import Table

from focusjax.baselines import load_unlit, mitsuba, unlit_scene
from focusjax.bench import baked
from focusjax.config import build_scene, load_config
from focusjax.exchange import TARGETS, export_camera
from focusjax.io import load_exr
from focusjax.job import run
from focusjax.layers import peel
from focusjax.metrics import psnr, ssim
from focusjax.trace import render

ROOT = Path(__file__).parents[1]
HERE = Path(__file__).parent


def by_mitsuba(file: Path, scene, folder: Path, options) -> np.ndarray:
    """What Mitsuba sees through the exported sensor; samples that are not finite count as black."""
    del folder
    mi = mitsuba(options.variant)
    sensor = mi.load_file(str(file)).sensors()[0]
    loaded = load_unlit(unlit_scene(scene), options.variant)
    total, done = 0.0, 0
    while done < options.samples:
        count = min(64, options.samples - done)
        seen = mi.render(loaded, sensor=sensor, integrator=loaded.integrator(), spp=count, seed=done)
        total = total + count * np.nan_to_num(np.array(seen)[..., -3:].astype(float))
        done += count
    return total / done + np.asarray(scene.background.colour)


def by_blender(file: Path, scene, folder: Path, options) -> np.ndarray:
    """What Cycles sees through the camera that the exported script makes."""
    mesh, picture = folder / "scene.npz", folder / "blender.exr"
    sky = np.asarray(scene.background.colour)
    np.savez(mesh, vertices=scene.vertices, faces=scene.faces, colours=scene.colours, sky=sky)
    made = HERE / "_in_blender.py"
    command = [options.python, made, file, mesh, picture, str(options.samples)]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if not picture.exists():
        raise SystemExit(f"Blender made no picture: {(done.stdout + done.stderr)[-2000:]}")
    channels = load_exr(picture)
    return np.stack([channels[name] for name in "RGB"], axis=-1).astype(float)


def compare(path: Path, options: argparse.Namespace, folder: Path) -> list[str]:
    """One row: how like our picture theirs is."""
    size = [] if options.size is None else [f"camera.resolution={options.size}"]
    config = load_config(path, [*(options.set or ()), *size])
    outcome = run(config, solving=bool(config.focus), rendering=False)
    camera, lens = outcome.camera, outcome.lens
    scene = baked(dataclasses.replace(build_scene(config), unlit=True))
    file = folder / f"{path.stem}{TARGETS[options.to].suffix}"
    ends = float(np.min(outcome.disparity)), float(np.max(outcome.disparity))
    exported = export_camera(
        camera, lens, file, to=options.to, approximate=options.to == "mitsuba", disparities=ends
    )
    layers = peel(
        scene, camera, lens, max_layers=config.render.max_layers, supersampling=options.supersampling
    )
    ours = np.asarray(render(layers, lens, rays=options.rays))
    theirs = {"mitsuba": by_mitsuba, "blender": by_blender}[options.to](file, scene, folder, options)
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
        np.savez(options.keep / f"{path.stem}_{options.to}.npz", ours=ours, theirs=theirs)
    widest = float(jnp.abs(lens.blur(camera, camera.principal_point, layers.disparity.max())))
    return [
        path.stem,
        options.to,
        f"{camera.width} x {camera.height}",
        f"{widest:.1f}",
        f"{exported.blur_error_px:.2f}",
        f"{psnr(ours, theirs):.2f}",
        f"{ssim(ours, theirs):.5f}",
    ]


def main() -> None:
    parser = make_parser(__doc__)
    still = [ROOT / "configs" / "still_life.toml"]
    parser.add_argument("configs", nargs="*", type=Path, default=still)
    parser.add_argument("--to", choices=("mitsuba", "blender"), default="mitsuba")
    parser.add_argument("--python", type=Path, default=Path("python"), help="a Python that has bpy")
    parser.add_argument("--variant", default="scalar_rgb", help="of Mitsuba")
    parser.add_argument("--size", type=int, nargs=2, metavar=("W", "H"), help="the configs' own by default")
    parser.add_argument("--rays", type=int, default=256)
    parser.add_argument("--samples", type=int, default=512, help="theirs, per pixel")
    parser.add_argument("--supersampling", type=int, default=2)
    parser.add_argument("--set", action="append", metavar="KEY=VALUE")
    parser.add_argument("--keep", type=Path, help="folder for both pictures")
    options = parser.parse_args()
    table = Table("config", "by", "pixels", "blur px", "error px", "PSNR dB", "SSIM")
    with tempfile.TemporaryDirectory() as folder:
        for path in options.configs:
            table.add_row(*compare(path, options, Path(folder)))
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
