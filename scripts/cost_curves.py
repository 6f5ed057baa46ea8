"""What a picture costs against pixels, rays, layers, blur size and triangles, and that nothing unused costs.

Each curve changes one thing and keeps the others. Seconds are medians of warm calls of `peel` and of
`render`; PSNR is that of the rays (`estimate_quality`), and for layers against the picture with all of them.
Then, all in this run and in turns, ratios: of a picture that is all in focus to one through a pinhole, and of
what is switched on to the same switched off. Last, the most memory that a process holds that makes one
picture of 1920 x 1080 with 100 rays, from triangles to radiance.

    python scripts/cost_curves.py --out out/cost
    python scripts/cost_curves.py --out out/cost --quick
"""

import argparse
import dataclasses
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, write_json
from _procedural import view as balls_view
from _shapes import in_world, quad_faces
from _special_scenes import chequers, lens_with, view
from _timing import timed, timed_in_turns
from bench_layers import balls

from focusjax.bench._measure import peak_memory
from focusjax.bench._run import machine
from focusjax.geometry import Camera
from focusjax.layers import peel
from focusjax.lens import ThinLens
from focusjax.metrics import psnr
from focusjax.scene import Scene, make_object, make_scene
from focusjax.trace import estimate_quality, plan_rays, render, render_pinhole

MEMORY_SIZE, MEMORY_RAYS, MEMORY_GIB = (1920, 1080), 100, 1.5
CURVES = {
    "pixels": ([(200, 150), (400, 300), (800, 600), (1600, 1200)], 2),
    "rays": ([4, 8, 16, 32, 64, 128, 256], 3),
    "layers": ([1, 2, 3, 4, 6, 8, 12, 16], 4),
    "blur px": ([1, 2, 4, 8, 16, 32, 64, 128], 4),
    "triangles": ([10_000, 100_000, 600_000, 2_000_000, 5_000_000], 3),
}
"""What each curve goes over, and how many of the places `--quick` takes."""


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the tables and the plot")
    parser.add_argument("--quick", action="store_true", help="fewer places, one warm call each")
    parser.add_argument("--memory-only", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


def bars(camera: Camera, count: int) -> Scene:
    """Rows of upright and level bars, one behind the other, each at another disparity."""
    objects, random = [], np.random.default_rng(0)
    for layer, disparity in enumerate(np.linspace(1.5, 0.3, count)):
        along, across = (camera.width, camera.height) if layer % 2 else (camera.height, camera.width)
        start = np.arange(-40, across + 40, 36.0) + random.uniform(0, 36)
        ends = np.array([(0.0, -80.0), (9.0, -80.0), (9.0, along + 80.0), (0.0, along + 80.0)])
        xy = (start[:, None, None] * np.array([1.0, 0.0]) + ends).reshape(-1, 2)
        points = in_world(xy[:, ::-1] if layer % 2 else xy, disparity, camera)
        colours = random.uniform(0.1, 0.9, (len(points) // 4, 3)).repeat(4, axis=0)
        objects.append(make_object(f"bars {layer}", points, quad_faces(len(start)), vertex_colours=colours))
    return make_scene(objects, unlit=True)


def point(scene: Scene, camera: Camera, lens: ThinLens, repeats: int, rays: int = 16) -> dict[str, float]:
    """Seconds and error of one picture."""
    layers = peel(scene, camera, lens, supersampling=1)
    picture = np.asarray(render(layers, lens, rays=rays))
    return {
        "peel s": timed(lambda: peel(scene, camera, lens, supersampling=1), repeats).median,
        "render s": timed(lambda: render(layers, lens, rays=rays), repeats).median,
        "PSNR": estimate_quality(layers, lens, picture, rays=rays).decibels,
        "layers": layers.filled,
    }


def curve(name: str, places: list, repeats: int) -> list[dict]:
    """One row for each place."""
    rows, most = [], None
    camera, lens = balls_view(400, 300)
    scene = balls(100_000)
    if name == "layers":
        camera = view(400, 300)
        scene, lens = bars(camera, 12), lens_with(camera, 0.8, 1.5, 24.0)
        whole = peel(scene, camera, lens, supersampling=1, max_layers=32)
        most = np.asarray(render(whole, lens, rays=64, smooth=False))
    for place in places:
        if name == "pixels":
            row = point(scene, *balls_view(*place), repeats)
        elif name == "rays":
            row = point(scene, camera, lens, repeats, rays=place)
        elif name == "triangles":
            row = point(balls(place), camera, lens, repeats)
        elif name == "blur px":
            # At infinity.
            radius = place / (2 * float(camera.focal_px) * float(lens.focus_disparity))
            row = point(
                scene, camera, dataclasses.replace(lens, aperture_radius=jnp.asarray(radius)), repeats
            )
        else:
            row = by_layers(scene, camera, lens, place, most, repeats)
        label = place if name != "pixels" else place[0] * place[1]
        rows.append({name: label, **row})
        print(f"{name} {place}: {row}", flush=True)
    return rows


def by_layers(
    scene: Scene, camera: Camera, lens: ThinLens, count: int, most: np.ndarray | None, repeats: int
) -> dict[str, float]:
    """As `point`, of so many layers, against the picture of all."""
    layers = peel(scene, camera, lens, supersampling=1, max_layers=count)
    picture = np.asarray(render(layers, lens, rays=64, smooth=False))
    return {
        "peel s": timed(lambda: peel(scene, camera, lens, supersampling=1, max_layers=count), repeats).median,
        "render s": timed(lambda: render(layers, lens, rays=64), repeats).median,
        "PSNR": min(psnr(picture, most), 99.0),
        "layers": layers.filled,
    }


def ratios(width: int, height: int, repeats: int) -> list[dict]:
    """What is not needed costs nothing: pairs of pictures and the ratio of their seconds."""
    camera = view(width, height)
    wall = make_scene([chequers(camera, 0.5, width / 20)], unlit=True)
    lens, closed = lens_with(camera, 0.5, 1.0, 40.0), ThinLens(jnp.asarray(0.5), jnp.asarray(0.0))
    sharp = peel(wall, camera, lens)
    pinhole = peel(wall, camera, closed)
    runs: dict[str, Callable[[], object]] = {
        "pinhole": lambda: render(pinhole, closed, rays=16),
        "in focus": lambda: render(sharp, lens, rays=16),
        "no rays": lambda: render_pinhole(pinhole),
    }
    scene = balls(100_000)
    view_camera, view_lens = balls_view(width, height)
    box, gaussian = (
        peel(scene, view_camera, view_lens, supersampling=1, pixel_filter=name)
        for name in ("box", "gaussian")
    )
    runs["box"] = lambda: render(box, view_lens, rays=16)
    runs["gaussian"] = lambda: render(gaussian, view_lens, rays=16)
    glossy = peel(scene, view_camera, view_lens, supersampling=1, view_dependent=True)
    runs["view-dependent, nothing glossy"] = lambda: render(glossy, view_lens, rays=16)
    clear = peel(_with_panes(scene), view_camera, view_lens, supersampling=1)
    runs["a small pane"] = lambda: render(clear, view_lens, rays=16)
    seconds = {name: min(found.wall[1:]) for name, found in timed_in_turns(runs, repeats).items()}
    pairs = [
        ("in focus", "pinhole"),
        ("in focus", "no rays"),
        ("gaussian", "box"),
        ("view-dependent, nothing glossy", "box"),
        ("a small pane", "box"),
    ]
    rows = [
        {"first": a, "second": b, "seconds": [seconds[a], seconds[b]], "ratio": seconds[a] / seconds[b]}
        for a, b in pairs
    ]
    planned = {
        "in focus": plan_rays(sharp, lens, "38 dB").rays,
        "balls": plan_rays(box, view_lens, "38 dB").rays,
    }
    return [*rows, {"planned rays": planned}]


def _with_panes(scene: Scene) -> Scene:
    """The scene with one triangle made of glass, so that every ray has to ask."""
    glass = dataclasses.replace(scene.materials[0], opacity=0.5)
    face_material = scene.face_material.copy()
    face_material[0] = len(scene.materials)
    return dataclasses.replace(scene, materials=(*scene.materials, glass), face_material=face_material)


def memory() -> dict[str, float]:
    """MiB at most, up to the end of each stage, of a process that does nothing else."""
    width, height = MEMORY_SIZE
    camera, lens = balls_view(width, height)
    scene = balls(600_000)
    out = {"scene": peak_memory()}
    layers = peel(scene, camera, lens, supersampling=1)
    out["peel"] = peak_memory()
    jax.block_until_ready(render(layers, lens, rays=MEMORY_RAYS))
    return {**out, "render": peak_memory()}


def measured_memory() -> dict[str, float]:
    command = [sys.executable, __file__, "--out", ".", "--memory-only"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def plot(curves: dict[str, list[dict]], file: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4 * len(curves), 4), layout="constrained")
    for axes, (name, rows) in zip(figure.subplots(1, len(curves)), curves.items(), strict=True):
        places = [row[name] for row in rows]
        for stage, style in (("peel s", "x--"), ("render s", "o-")):
            axes.loglog(places, [row[stage] for row in rows], style, label=stage)
        axes.set_xlabel(name)
        axes.grid(alpha=0.3, which="both")
        axes.legend(loc="upper left")
        error = axes.twinx()
        error.plot(places, [row["PSNR"] for row in rows], "^:", color="C2")
        error.set_ylabel("PSNR, dB", color="C2")
    figure.savefig(file, dpi=120)


def markdown(curves: dict[str, list[dict]], lines_of: list[dict], mib: dict[str, float]) -> str:
    out = []
    for name, rows in curves.items():
        out += [f"| {name} | peel s | render s | PSNR dB | layers |", "| --- | --- | --- | --- | --- |"]
        for row in rows:
            out.append(
                f"| {row[name]:,} | {row['peel s']:.2f} | {row['render s']:.2f} | {row['PSNR']:.1f}"
                f" | {row['layers']} |"
            )
        out.append("")
    out += ["| Picture | beside | seconds | ratio |", "| --- | --- | --- | --- |"]
    for row in lines_of[:-1]:
        first, second = row["seconds"]
        out.append(f"| {row['first']} | {row['second']} | {first:.2f}, {second:.2f} | {row['ratio']:.2f} |")
    planned = ", ".join(f"{name} {rays}" for name, rays in lines_of[-1]["planned rays"].items())
    width, height = MEMORY_SIZE
    out += ["", f"Rays planned for 38 dB: {planned}.", ""]
    stages = ", ".join(f"{value / 1024:.2f} after {stage}" for stage, value in mib.items())
    out.append(
        f"{width} x {height}, {MEMORY_RAYS} rays, 600,000 triangles, GiB at most: {stages}"
        f" (wanted: {MEMORY_GIB})."
    )
    return "\n".join(out) + "\n"


def main() -> None:
    options = arguments()
    if options.memory_only:
        print(json.dumps(memory()))
        return
    options.out.mkdir(parents=True, exist_ok=True)
    about, repeats = machine(), 1 if options.quick else 3
    mib = measured_memory()
    curves = {
        name: curve(name, places[:quick] if options.quick else places, repeats)
        for name, (places, quick) in CURVES.items()
    }
    lines = ratios(400, 300, 5) if options.quick else ratios(800, 600, 7)
    text = markdown(curves, lines, mib)
    print(text)
    (options.out / "cost.md").write_text(text)
    result = {"machine": about, "curves": curves, "ratios": lines, "peak memory MiB": mib}
    write_json(options.out / "cost.json", result)
    plot(curves, options.out / "cost.png")


if __name__ == "__main__":
    main()
