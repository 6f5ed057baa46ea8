"""focusjax beside a denoised path tracer: seconds and PSNR of both on the same scenes, in one run.

The path tracer is Mitsuba 3 in its form for CPUs (llvm_ad_rgb) with its thin lens and multi-jittered samples,
asked for the albedo alone, as the scenes are unlit; the denoiser is Open Image Denoise. Both are the quickest
form that a user would take. Pictures are 800 x 600, errors those of linear radiance against Mitsuba with at
least 1024 samples; samples that are not finite are left out, and counted in the table.

After a first call, whose excess is the time to compile, all pictures of a scene are made in turns,
`--repeats` times, so that whatever else the machine does falls on all alike; seconds are medians. Then come
the rows that are derived from these:

    a  to the error of Mitsuba with 16 samples and the denoiser, with layers given: how many times as quick
       focusjax is. Its time is read off its curve of each supersampling, log seconds against dB, and the
       quickest counts.
    b  the same with the time to peel, at the default supersampling.
    c  the same from arrays of triangles: make the scene and peel, against Mitsuba's mesh and tree.
    d  seconds of each further ray per pixel, and of each further sample of Mitsuba.
    e  peeling at the default supersampling, against Mitsuba's 16 samples.
    f  the error that one layer sample per pixel stops at: supersampling 1, 128 rays.
    g  as b, for each of 32 lenses that one peel serves: a lens that moves compiles nothing and takes as long.

Run it on a quiet machine, with DRJIT_LIBLLVM_PATH set where the loader does not find LLVM.

    python scripts/compare_denoised.py --scenes scan-1 leaves-1 --cache out/references --json out/all.json
"""

import argparse
import inspect
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _command_line import make_parser, make_table, write_json
from _compared_scenes import SCENES, Compared
from _timing import timed_in_turns
from rich.console import Console
from rich.table import Table

from focusjax.baselines import UnlitScene, denoised, load_unlit, mitsuba_picture, unlit_scene
from focusjax.bench import Case, Reach, reference_picture, time_to_reach
from focusjax.bench._run import machine
from focusjax.io import for_json
from focusjax.layers import Layers, peel
from focusjax.metrics import psnr
from focusjax.scene import Scene, make_object, make_scene
from focusjax.trace import render

DEFAULT_SUPERSAMPLING = int(inspect.signature(peel).parameters["supersampling"].default)
FLOOR_RAYS = 128
LENSES = 32
TARGET = ("mitsuba+oidn", 16)
"""Whose error the derived rows are at."""


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=["scan-2", "leaves-2"])
    parser.add_argument("--rays", nargs="+", type=int, default=[2, 4, 8, 16, 64], help="of focusjax")
    parser.add_argument("--supersampling", nargs="+", type=int, default=[1, 2], help="of focusjax")
    parser.add_argument("--max-layers", type=int, default=16)
    parser.add_argument("--samples", nargs="+", type=int, default=[4, 8, 16, 64], help="of Mitsuba")
    parser.add_argument("--repeats", type=int, default=5, help="calls after the first")
    parser.add_argument("--reference-samples", type=int, default=1024)
    parser.add_argument("--cache", type=Path, required=True, help="folder that keeps the references")
    parser.add_argument("--json", type=Path, help="file for the results")
    options = parser.parse_args()
    if options.reference_samples < 1024:
        parser.error(f"--reference-samples is {options.reference_samples}; expected at least 1024")
    if options.repeats < 1:
        parser.error(f"--repeats is {options.repeats}; expected at least 1 call after the first")
    for option in ("rays", "supersampling", "samples"):
        if min(getattr(options, option)) < 1:
            parser.error(f"--{option} is {getattr(options, option)}; expected whole numbers, at least 1")
    options.samples = sorted({*options.samples, TARGET[1]})
    options.supersampling = sorted({*options.supersampling, 1, DEFAULT_SUPERSAMPLING})
    return options


def from_arrays(scene: Scene) -> Scene:
    """The scene, made again from its vertices, triangles and colours."""
    surface = make_object("all", scene.vertices, scene.faces, vertex_colours=scene.colours)
    return make_scene([surface], background=scene.background, unlit=True)


def pictures(
    compared: Compared, unlit: UnlitScene, layers: dict[int, Layers], options: argparse.Namespace
) -> dict[tuple[str, int], Callable[[], Any]]:
    """What makes each picture, by method and number of rays or samples."""
    _, camera, lens = compared

    def ours(supersampling: int, rays: int) -> Callable[[], Any]:
        return lambda: render(layers[supersampling], lens, rays=rays)

    def theirs(samples: int, *, denoise: bool) -> Callable[[], Any]:
        def run() -> np.ndarray:
            noisy = mitsuba_picture(unlit, camera, lens, samples=samples)
            return denoised(noisy) if denoise else noisy

        return run

    return {
        **{(f"focusjax at {s}", rays): ours(s, rays) for s in layers for rays in options.rays},
        **{("mitsuba", samples): theirs(samples, denoise=False) for samples in options.samples},
        **{("mitsuba+oidn", samples): theirs(samples, denoise=True) for samples in options.samples},
    }


def set_ups(
    compared: Compared, unlit: UnlitScene, options: argparse.Namespace
) -> dict[tuple[str, int], Callable[[], Any]]:
    """What comes before the pictures: scenes from arrays, layers, and Mitsuba's mesh and tree."""
    scene, camera, lens = compared

    def peels(supersampling: int) -> Callable[[], Any]:
        return lambda: peel(scene, camera, lens, supersampling=supersampling, max_layers=options.max_layers)

    # Past the cache that keeps loaded scenes.
    load = load_unlit.__wrapped__
    return {
        ("make scene", 0): lambda: from_arrays(scene),
        ("load mitsuba", 0): lambda: load(unlit),
        **{("peel", supersampling): peels(supersampling) for supersampling in options.supersampling},
    }


def compare(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """All rows of one scene, measured and derived."""
    compared = SCENES[name]()
    scene, camera, lens = compared
    case = Case(name, name, scene, camera, lens, options.max_layers)
    reference = reference_picture(
        case, maker="mitsuba", samples=options.reference_samples, cache=options.cache
    )
    unlit = unlit_scene(scene)
    prepared = timed_in_turns(set_ups(compared, unlit, options), options.repeats)
    set_up = {key: found.median for key, found in prepared.items()}
    layers = {number: prepared["peel", number].result for number in options.supersampling}
    made = timed_in_turns(pictures(compared, unlit, layers, options), options.repeats)
    rows = [
        {
            "method": method,
            "setting": setting,
            "seconds": found.median,
            "best seconds": min(found.wall[1:]),
            "compile seconds": max(0.0, found.first - found.median),
            "psnr": psnr(np.asarray(found.result), reference.picture),
        }
        for (method, setting), found in made.items()
    ]
    floor = psnr(np.asarray(render(layers[1], lens, rays=FLOOR_RAYS)), reference.picture)
    return {
        "scene": name,
        "triangles": len(scene.faces),
        "width": camera.width,
        "height": camera.height,
        "reference": {
            "samples": reference.samples,
            "floor psnr": reference.floor_psnr,
            "not finite": reference.dropped,
        },
        "layers": {
            number: {"count": each.filled, "complete": each.complete} for number, each in layers.items()
        },
        "set-up seconds": {" ".join(str(part) for part in key if part): set_up[key] for key in set_up},
        "rows": rows,
        "derived": derived(rows, set_up, floor),
    }


def derived(
    rows: list[dict[str, Any]], set_up: dict[tuple[str, int], float], floor: float
) -> dict[str, dict[str, Any]]:
    """The rows a to f of the module's description.

    Args:
        rows: seconds and PSNR of every method and setting.
        set_up: seconds of `make scene`, `load mitsuba` and `peel` at each supersampling.
        floor: dB of one layer sample per pixel.
    """
    target = next(row for row in rows if (row["method"], row["setting"]) == TARGET)
    plain = next(row for row in rows if (row["method"], row["setting"]) == ("mitsuba", TARGET[1]))
    reaches: dict[int, Reach] = {}
    for number in (number for kind, number in set_up if kind == "peel"):
        points = [(row["seconds"], row["psnr"]) for row in rows if row["method"] == f"focusjax at {number}"]
        reaches[number] = time_to_reach(points, target["psnr"])
    quickest = min(reaches, key=lambda number: reaches[number].seconds)
    default = DEFAULT_SUPERSAMPLING
    peeling = set_up["peel", default]
    made, loaded = set_up["make scene", 0], set_up["load mitsuba", 0]
    there = target["seconds"]

    def row(supersampling: int, before: float, theirs: float) -> dict[str, Any]:
        reach = reaches[supersampling]
        ours = reach.seconds + before
        return {
            "ours s": ours,
            "theirs s": theirs,
            "times as quick": theirs / ours,
            "at least": reach.at_most,
            "supersampling": supersampling,
            "dB": target["psnr"],
        }

    further = further_ray(rows, f"focusjax at {default}"), further_ray(rows, "mitsuba")
    return {
        "a": row(quickest, 0.0, there),
        "b": row(default, peeling, there),
        "c": row(default, made + peeling, loaded + there),
        "d": {"ours s": further[0], "theirs s": further[1], "times as quick": further[1] / further[0]},
        "e": {
            "ours s": peeling,
            "theirs s": plain["seconds"],
            "times as quick": plain["seconds"] / peeling,
        },
        "f": {"dB": floor},
        "g": row(default, peeling / LENSES, there),
    }


def further_ray(rows: list[dict[str, Any]], method: str) -> float:
    """Seconds of each further ray per pixel, between the two largest counts of a method."""
    counts = sorted((row["setting"], row["seconds"]) for row in rows if row["method"] == method)
    if len(counts) < 2:
        return math.nan
    (few, quick), (many, slow) = counts[-2:]
    return (slow - quick) / (many - few)


LABELS = {
    "a": "to the error of Mitsuba 16 + denoiser, layers given",
    "b": "the same with peeling",
    "c": "the same from arrays of triangles",
    "d": "each further ray, sample per pixel",
    "e": "peeling, Mitsuba 16 samples",
    "f": "one layer sample per pixel, 128 rays",
    "g": "a picture of 32 lenses that one peel serves",
}


def measured_table(result: dict[str, Any]) -> Table:
    reference = result["reference"]
    title = (
        f"{result['scene']}: {result['triangles']:,} triangles, {result['width']} x {result['height']};"
        f" reference {reference['samples']} samples, good to {reference['floor psnr']:.1f} dB,"
        f" {reference['not finite']} not finite"
    )
    table = make_table(title, "method", "rays, samples", "seconds", "best", "compile s", "PSNR dB")
    for row in result["rows"]:
        table.add_row(
            row["method"],
            str(row["setting"]),
            f"{row['seconds']:.3f}",
            f"{row['best seconds']:.3f}",
            f"{row['compile seconds']:.2f}",
            f"{row['psnr']:.2f}",
        )
    for name, seconds in result["set-up seconds"].items():
        table.add_row(name, "", f"{seconds:.3f}", "", "", "")
    return table


def derived_table(results: list[dict[str, Any]]) -> Table:
    headings = ("", "", "scene", "ours s", "theirs s", "times as quick", "dB")
    table = make_table("focusjax beside Mitsuba and its denoiser", *headings, left=3)
    for letter, label in LABELS.items():
        for result in results:
            row = result["derived"][letter]
            reached = math.isfinite(row.get("ours s", math.nan))
            ratio = f"{'≥ ' if row.get('at least') else ''}{row['times as quick']:.2f}" if reached else ""
            ours = f"{row['ours s']:.4f}" if reached else "not reached" if "ours s" in row else ""
            table.add_row(
                letter,
                label,
                result["scene"],
                ours,
                f"{row['theirs s']:.4f}" if "theirs s" in row else "",
                ratio,
                f"{row['dB']:.2f}" if "dB" in row else "",
            )
    return table


def main() -> None:
    options = arguments()
    about, console = machine(), Console()
    console = Console(width=max(130, console.width))
    results = []
    for name in options.scenes:
        results.append(compare(name, options))
        console.print(measured_table(results[-1]))
        # After every scene, so that what is measured is kept whatever comes.
        write_json(options.json, for_json({"machine": about, "scenes": results}))
    console.print(derived_table(results))
    print(json.dumps(about))


if __name__ == "__main__":
    main()
