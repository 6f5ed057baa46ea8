"""Which layers a picture needs: peeled with the umbra, plainly, or cut into slabs, at several apertures.

For each scene and aperture two tables are made. The first compares layers of each kind: the PSNR of their
pictures against a converged one, the light they miss, and the seconds to build and to trace them (of the
second call, so without compiling). The second counts what the umbra saves against plain peeling.

The scenes are configs, with unlit baked colours as for `focusjax bench`, and copies of meshes as for
bench_render.py. Apertures are multiples of the radius that the config's wishes are solved for.

    python scripts/layer_study.py configs/bars.toml configs/town.toml --references folder
    python scripts/layer_study.py --mesh dragon.ply --json study.json --csv study.csv
"""

import argparse
import csv
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

from _command_line import make_parser, make_table, write_json
from _procedural import timed_scene, view
from _timing import timed
from _truth import truth
from rich.console import Console
from rich.table import Table

from focusjax import job
from focusjax.baselines import nearest_in_scene
from focusjax.bench import baked, resized
from focusjax.bench._run import machine
from focusjax.config import build_scene, load_config
from focusjax.geometry import Camera
from focusjax.layers import Layers, decompose, missed_light, peel, umbra_saving
from focusjax.lens import Disk, ThinLens
from focusjax.metrics import psnr
from focusjax.scene import Scene
from focusjax.trace import render

View = tuple[str, Scene, Camera, ThinLens]


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("configs", nargs="*", type=Path, help="scenes to study")
    parser.add_argument("--mesh", nargs="+", type=Path, default=[], help="files to study copies of as well")
    parser.add_argument("--width", type=int, default=400)
    parser.add_argument("--height", type=int, default=300)
    parser.add_argument("--supersampling", type=int, default=2)
    parser.add_argument("--apertures", nargs="+", type=float, default=[0.5, 1.0, 2.0], help="multiples")
    parser.add_argument("--counts", nargs="+", type=int, default=[4, 8, 16], help="of layers, and of slabs")
    parser.add_argument("--full", type=int, default=24, help="layers of plain peeling")
    parser.add_argument("--rays", type=int, default=64, help="per pixel")
    parser.add_argument("--examined", type=int, default=1 << 17, help="rays that measure the missed light")
    parser.add_argument("--samples", type=int, default=1024, help="per pixel, for the reference")
    parser.add_argument("--references", type=Path, help="folder that keeps the converged pictures")
    parser.add_argument("--radius", type=float, default=0.05, help="aperture radius in metres for meshes")
    parser.add_argument("--focus", type=float, default=5.0, help="focus distance in metres for meshes")
    parser.add_argument("--json", type=Path, help="file for the results")
    parser.add_argument("--csv", type=Path, help="file for the first table's rows, of all scenes")
    options = parser.parse_args()
    if not options.configs and not options.mesh:
        parser.error("nothing to study: name a config, or a mesh with --mesh")
    return options


def views(options: argparse.Namespace) -> Iterator[View]:
    """What to study: a name, the unlit scene, the camera and the lens at its ordinary aperture."""
    for path in options.configs:
        config = load_config(path)
        outcome = job.run(config, rendering=False)
        camera = resized(outcome.camera, options.width, options.height)
        yield (
            path.stem,
            baked(build_scene(config)),
            camera,
            dataclasses.replace(outcome.lens, aperture=Disk()),
        )
    if options.mesh:
        scene, _ = timed_scene(options.mesh, None, 0)
        seen = view(options.width, options.height, focus=options.focus, radius=options.radius)
        yield " ".join(path.stem for path in options.mesh), scene, *seen


def ways(
    scene: Scene, camera: Camera, lens: ThinLens, options: argparse.Namespace
) -> dict[str, Callable[[], Layers]]:
    """How to make layers, by name."""

    def peeled(count: int, *, umbra: bool) -> Callable[[], Layers]:
        return lambda: peel(
            scene, camera, lens, supersampling=options.supersampling, max_layers=count, umbra=umbra
        )

    def slabs(count: int) -> Callable[[], Layers]:
        return lambda: decompose(scene, camera, lens, supersampling=options.supersampling, count=count)

    return {
        **{f"umbra {count}": peeled(count, umbra=True) for count in options.counts},
        **{f"slabs {count}": slabs(count) for count in options.counts},
        f"plain {options.full}": peeled(options.full, umbra=False),
    }


def study(name: str, scene: Scene, camera: Camera, lens: ThinLens, aperture: float, options) -> dict:
    """All numbers of one scene at one aperture, times in seconds."""
    lens = dataclasses.replace(lens, aperture_radius=aperture * lens.aperture_radius)
    kept = None if options.references is None else options.references / f"{name} {aperture:g}.npz"
    reference, maker = truth(kept, scene, camera, lens, options.samples)
    nearest = nearest_in_scene(scene, camera)
    rows = []
    for way, build in ways(scene, camera, lens, options).items():
        built = timed(build, 1)
        layers = built.result
        traced = timed(lambda these=layers: render(these, lens, rays=options.rays, smooth=False), 1)
        missed = missed_light(layers, nearest, rays=options.examined)
        rows.append(
            {
                "way": way,
                "layers": layers.filled,
                "complete": layers.complete,
                "samples": layers.samples_kept,
                "psnr": psnr(traced.result, reference),
                "missed": missed.share,
                "missed error": missed.standard_error,
                "build": built.median,
                "trace": traced.median,
            }
        )
    saving = umbra_saving(scene, camera, lens, supersampling=options.supersampling)
    extremes = layers.ranges.overall
    widest = max(abs(float(lens.blur(camera, camera.principal_point, w))) for w in extremes)
    return {
        "scene": name,
        "aperture": aperture,
        "f-number": float(lens.f_number(camera)),
        "widest blur px": widest,
        "reference": maker,
        "ways": rows,
        "umbra": saving.umbra,
        "plain": saving.plain,
        "samples saved": saving.samples_saved,
    }


def comparison(result: dict, options: argparse.Namespace) -> Table:
    title = (
        f"{result['scene']}, aperture x {result['aperture']:g} (f/{result['f-number']:.2g}), blur up to"
        f" {result['widest blur px']:.0f} px, {options.width} x {options.height}, {options.rays} rays"
    )
    headings = ("way", "layers", "samples", "PSNR", "missed light", "build", "trace")
    table = make_table(title, *headings, caption=f"against {result['reference']}; + where more was left")
    for row in result["ways"]:
        table.add_row(
            row["way"],
            f"{row['layers']}{'' if row['complete'] else '+'}",
            f"{row['samples'] / 1e6:.2f} M",
            f"{row['psnr']:.2f} dB",
            f"{100 * row['missed']:.3f} ± {100 * row['missed error']:.3f} %",
            f"{row['build']:.2f} s",
            f"{row['trace']:.2f} s",
        )
    return table


def savings(results: list[dict]) -> Table:
    headings = ("scene", "aperture", "layers: plain", "umbra", "samples: plain", "umbra", "saved")
    table = make_table("What the umbra saves: layers and samples kept, to the last surface", *headings)
    for result in results:
        table.add_row(
            result["scene"],
            f"x {result['aperture']:g}",
            str(len(result["plain"])),
            str(len(result["umbra"])),
            f"{sum(result['plain']) / 1e6:.2f} M",
            f"{sum(result['umbra']) / 1e6:.2f} M",
            f"{100 * result['samples saved']:.0f} %",
        )
    return table


def main() -> None:
    options = arguments()
    console = Console(width=max(110, Console().width))
    if options.references is not None:
        options.references.mkdir(parents=True, exist_ok=True)
    about, results = machine(), []
    for name, scene, camera, lens in views(options):
        for aperture in options.apertures:
            results.append(study(name, scene, camera, lens, aperture, options))
            console.print(comparison(results[-1], options))
    console.print(savings(results))
    write_json(options.json, {"machine": about, "results": results})
    if options.csv is not None:
        with options.csv.open("w", newline="") as file:
            places = ("scene", "aperture", "f-number", "widest blur px")
            writer = csv.DictWriter(file, [*places, *results[0]["ways"][0]])
            writer.writeheader()
            for result in results:
                for row in result["ways"]:
                    writer.writerow({**{place: result[place] for place in places}, **row})


if __name__ == "__main__":
    main()
