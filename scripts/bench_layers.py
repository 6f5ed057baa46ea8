"""Seconds and memory of peeling against the number of triangles and of pixels, beside Mitsuba's ray cast.

Every case runs in a process of its own: lumpy balls before a wall, at one size of picture. The first call
shows what compiling costs; the medians of the calls after it are the stages:

    frame     project, clip, find the margin and the triangles that rays can reach
    raster    all samples that triangles cover
    peel      the fragments of each layer, by the extended umbra
    assemble  attributes, shading, joins, silhouettes, N-buffers

Mitsuba (llvm_ad_rgb, whose rays are Embree's, on all cores) casts a ray through every sample of the layers,
then again from behind each hit, as many times as there are layers. Its tree is built before, and timed apart,
as is the first cast, which compiles. Without Mitsuba `--mitsuba-up-to 0` leaves it out.

    python scripts/bench_layers.py --csv layers.csv --plot layers.png
"""

import argparse
import csv
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
import trimesh
from _command_line import make_parser, make_table, write_json
from _procedural import placements, view, wall
from rich.console import Console
from rich.table import Table

from focusjax.baselines import UnlitScene, load_unlit, mitsuba
from focusjax.bench._measure import peak_memory
from focusjax.bench._run import machine
from focusjax.geometry import Camera
from focusjax.layers import Layers
from focusjax.layers._assemble import assemble
from focusjax.layers._frame import frame
from focusjax.layers._peel import peel_fragments
from focusjax.layers._picture import rasterised
from focusjax.lens import ThinLens
from focusjax.scene import Scene, make_object, make_scene

TRIANGLES = (10_000, 100_000, 600_000, 1_000_000, 5_000_000, 10_000_000)
SIZES = ("800x600", "1920x1080")
STAGES = ("frame", "raster", "peel", "assemble")


def balls(triangles: int, seed: int = 0) -> Scene:
    """About so many `triangles` in lumpy balls, the larger the more there are, before a painted wall."""
    random = np.random.default_rng(seed)
    subdivisions = 3 if triangles < 50_000 else 4 if triangles < 800_000 else 5 if triangles < 4e6 else 6
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    count = max(1, round(triangles / len(ball.faces)))
    vertices, colours = [], []
    for place in placements(count, random):
        lumps = 1.0 + 0.05 * np.sin(ball.vertices @ random.normal(scale=5.0, size=(3, 3))).sum(axis=1)
        vertices.append(random.uniform(0.1, 0.35) * lumps[:, None] * ball.vertices + place)
        stripes = 0.65 + 0.35 * np.sin(14.0 * ball.vertices @ random.normal(size=3))
        colours.append(random.uniform(0.1, 1.0, 3) * stripes[:, None])
    shift = len(ball.vertices) * np.arange(count)
    faces = (ball.faces[None] + shift[:, None, None]).reshape(-1, 3)
    surface = make_object(
        "balls",
        np.concatenate(vertices),
        faces,
        vertex_colours=np.concatenate(colours),
        smooth_angle=180.0,
    )
    return make_scene([surface, wall()], unlit=True)


def staged_peel(
    scene: Scene, camera: Camera, lens: ThinLens, supersampling: int, most: int
) -> tuple[Layers, dict[str, float]]:
    """The layers, and seconds per stage."""
    seconds, clock = {}, time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[stage], clock = now - clock, now

    triangles, grid = frame(scene, camera, lens, supersampling, None)
    lap("frame")
    picture = rasterised(scene, camera, triangles, grid)
    lap("raster")
    parallax = float(lens.parallax(camera)) * supersampling
    chosen, left_out = peel_fragments(picture.fragments, grid, parallax, most)
    lap("peel")
    counts = [len(some) for some in chosen]
    layers = assemble(scene, camera, lens, picture.held(chosen), counts, max_layers=most, left_out=left_out)
    jax.block_until_ready(layers)
    lap("assemble")
    return layers, seconds


def mitsuba_casts(scene: Scene, layers: Layers, repeats: int) -> tuple[float, list[float]]:
    """Seconds to build the tree, and medians of those to cast the rays of all samples, layer by layer."""
    mi = mitsuba()
    import drjit as dr  # comes with Mitsuba

    triangles = UnlitScene(scene.vertices, scene.faces, scene.colours, (0.0, 0.0, 0.0))
    start = time.perf_counter()
    loaded = load_unlit(triangles)
    built = time.perf_counter() - start
    grid, camera = layers.grid, layers.camera
    x, y = np.meshgrid(np.arange(grid.columns) + 0.5, np.arange(grid.rows) + 0.5)
    xy = (np.stack([x, y], axis=-1).reshape(-1, 2) - grid.margin) / grid.supersampling
    right, down = ((xy - np.asarray(camera.principal_point)) / float(camera.focal_px)).T
    pose = np.asarray(camera.world_from_camera)
    directions = np.stack([right, -down, -np.ones_like(right)], axis=1) @ pose[:3, :3].T
    eye, all_directions = mi.Point3f(*pose[:3, 3].tolist()), mi.Vector3f(directions.T)

    def cast_all() -> list[float]:
        seconds, directions = [], all_directions
        depth = dr.zeros(mi.Float, len(x.ravel()))
        for _ in range(layers.filled):
            ray = mi.Ray3f(eye + directions * depth, directions)
            dr.eval(ray)
            dr.sync_thread()
            start = time.perf_counter()
            hits = loaded.ray_intersect_preliminary(ray)
            found = hits.is_valid()
            dr.eval(hits, found)
            dr.sync_thread()
            seconds.append(time.perf_counter() - start)
            going_on: Any = dr.compress(found)
            directions = dr.gather(mi.Vector3f, directions, going_on)
            depth = dr.gather(mi.Float, depth + hits.t, going_on) * (1 + 1e-5)
        return seconds

    cast_all()
    several = [cast_all() for _ in range(repeats)]
    return built, [statistics.median(each) for each in zip(*several, strict=True)]


def run_case(options: argparse.Namespace) -> dict[str, object]:
    """One case, in this process."""
    width, height = (int(number) for number in options.size[0].split("x"))
    scene, (camera, lens) = balls(options.triangles[0]), view(width, height)
    memory = {"scene": peak_memory()}
    runs, totals = [], []
    for _ in range(options.repeats + 1):
        start = time.perf_counter()
        layers, seconds = staged_peel(scene, camera, lens, options.supersampling, options.max_layers)
        totals.append(time.perf_counter() - start)
        runs.append(seconds)
    memory["peel"] = peak_memory()
    warm = statistics.median(totals[1:])
    result = {
        "triangles": len(scene.faces),
        "width": width,
        "height": height,
        "seconds": warm,
        "compile": max(0.0, totals[0] - warm),
        **{stage: statistics.median(run[stage] for run in runs[1:]) for stage in STAGES},
        "layers": layers.filled,
        "complete": layers.complete,
        "kept": layers.samples_kept,
        "samples": layers.grid.size,
        "layers MiB": layers.nbytes / 2**20,
        "peak MiB with scene": memory["scene"],
        "peak MiB": memory["peel"],
    }
    if len(scene.faces) <= options.mitsuba_up_to:
        result["mitsuba build"], casts = mitsuba_casts(scene, layers, options.repeats)
        result["mitsuba first cast"], result["mitsuba cast"] = casts[0], sum(casts)
    return result


def in_own_process(triangles: int, size: str, options: argparse.Namespace) -> dict[str, object]:
    """One case, in a new process, so that its peak memory is its own."""
    command = [sys.executable, __file__, "--case", "--triangles", str(triangles), "--size", size]
    for name in ("supersampling", "max_layers", "repeats", "mitsuba_up_to"):
        command += [f"--{name.replace('_', '-')}", str(getattr(options, name))]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{triangles} triangles at {size}: {done.stderr.strip().splitlines()[-1:]}")
    return json.loads(done.stdout.splitlines()[-1])


def table(results: list[dict]) -> Table:
    headings = ("triangles", "size", "all", *STAGES, "compile", "layers", "kept", "layers MiB", "peak MiB")
    headings = (*headings, "Mitsuba: tree", "first cast", "all casts", "ours / casts")
    out = make_table("peeling, warm, seconds", *headings, left=0)
    for row in results:
        cast = row.get("mitsuba cast")
        out.add_row(
            f"{row['triangles']:,}",
            f"{row['width']} x {row['height']}",
            *(f"{row[name]:.2f}" for name in ("seconds", *STAGES, "compile")),
            f"{row['layers']}{'' if row['complete'] else '+'}",
            f"{row['kept'] / row['samples']:.2f} per sample",
            *(f"{row[name]:.0f}" for name in ("layers MiB", "peak MiB")),
            *(f"{row[f'mitsuba {name}']:.3f}" for name in ("build", "first cast", "cast") if cast),
            *((f"{row['seconds'] / cast:.1f}",) if cast else ()),
        )
    return out


def plot(results: list[dict], path: Path) -> None:
    """Seconds against triangles for each size, and against pixels for each number of triangles."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.5), layout="constrained")
    against_triangles, against_pixels = figure.subplots(1, 2)
    for size in sorted({(row["width"], row["height"]) for row in results}):
        rows = [row for row in results if (row["width"], row["height"]) == size]
        label = f"{size[0]} x {size[1]}"
        against_triangles.loglog(
            [r["triangles"] for r in rows], [r["seconds"] for r in rows], "o-", label=label
        )
        if any("mitsuba cast" in row for row in rows):
            cast = [(r["triangles"], r["mitsuba cast"]) for r in rows if "mitsuba cast" in r]
            against_triangles.loglog(*zip(*cast, strict=True), "x--", label=f"{label}, Mitsuba's casts")
    for triangles in sorted({row["triangles"] for row in results}):
        rows = [row for row in results if row["triangles"] == triangles]
        pixels = [row["width"] * row["height"] / 1e6 for row in rows]
        against_pixels.plot(pixels, [row["seconds"] for row in rows], "o-", label=f"{triangles:,}")
    against_triangles.set_xlabel("triangles")
    against_pixels.set_xlabel("million pixels")
    for axes in (against_triangles, against_pixels):
        axes.set_ylabel("seconds, warm")
        axes.grid(alpha=0.3, which="both")
        axes.legend()
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--triangles", nargs="+", type=int, default=TRIANGLES)
    parser.add_argument("--size", nargs="+", default=SIZES, metavar="WIDTHxHEIGHT")
    parser.add_argument("--supersampling", type=int, default=1)
    parser.add_argument("--max-layers", type=int, default=16)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--mitsuba-up-to", type=int, default=11_000_000, help="triangles; 0 leaves it out")
    parser.add_argument("--csv", type=Path, help="file for the results")
    parser.add_argument("--json", type=Path, help="file for the results")
    parser.add_argument("--plot", type=Path, help="picture of the curves")
    parser.add_argument("--case", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(run_case(options)))
        return
    about = machine()
    results = []
    for size in options.size:
        for triangles in options.triangles:
            results.append(in_own_process(triangles, size, options))
            print(
                f"{size}, {results[-1]['triangles']:,} triangles: {results[-1]['seconds']:.2f} s", flush=True
            )
    Console(width=max(170, Console().width)).print(table(results))
    print(json.dumps(about))
    write_json(options.json, {"machine": about, "cases": results})
    if options.csv is not None:
        with options.csv.open("w", newline="") as file:
            names = list(dict.fromkeys(name for row in results for name in row))
            writer = csv.DictWriter(file, names)
            writer.writeheader()
            writer.writerows(results)
    if options.plot is not None:
        plot(results, options.plot)


if __name__ == "__main__":
    main()
