"""Pictures on a GPU: milliseconds, memory and agreement with the processor's.

Layers are peeled by the processor and put onto JAX's default device. Each picture is made once to compile,
then `--repeats` times; milliseconds are medians with the picture left on the device. It is compared with:

    CPU       the same picture by this machine's processor: root mean square difference
    PSNR      of linear radiance, against Mitsuba with 1024 samples; the folder `--cache` keeps what its
              variant for processors made, be it on another machine
    mitsuba   its cuda variant on the same scene, where it runs, and how many times as quick focusjax is to
              the same error, between Mitsuba's numbers of samples by log seconds against dB

Every line is printed as JSON as soon as it is there, and written to `--json` with the device's name.

    python scripts/bench_gpu.py --scenes scan-2 leaves-2 --cache out/references --json out/gpu.json
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, write_json
from _compared_scenes import SCENES, Compared
from _timing import timed

from focusjax.bench import Case, reference_picture, time_to_reach
from focusjax.bench._run import machine
from focusjax.layers import Layers, peel
from focusjax.lens import ThinLens
from focusjax.metrics import psnr
from focusjax.trace import render

Row = dict[str, Any]


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=["scan-2", "leaves-2"])
    parser.add_argument("--rays", nargs="+", type=int, default=[4, 16, 100])
    parser.add_argument(
        "--samples", nargs="+", type=int, default=[4, 16, 64, 100, 256], help="of Mitsuba; 0 for none"
    )
    parser.add_argument("--max-layers", type=int, default=4)
    parser.add_argument("--supersampling", type=int, default=1)
    parser.add_argument("--lenses", type=int, default=32, help="one after the other, of 16 rays")
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--cache", type=Path, help="folder that keeps the references; no PSNR without")
    parser.add_argument("--profile", type=int, default=0, help="how many of the costliest kernels to list")
    parser.add_argument("--json", type=Path, help="file for the results")
    return parser.parse_args()


def measured(run: Callable[[], Any], repeats: int) -> tuple[Any, Row]:
    """The result, seconds of the first call and milliseconds of the others."""
    found = timed(run, repeats)
    if not repeats:
        return found.result, {}
    best = 1000 * min(found.wall[1:])
    return found.result, {"first s": found.first, "ms": 1000 * found.median, "best ms": best}


def on(device: Any, layers: Layers) -> Layers:
    return jax.tree.map(lambda leaf: jax.device_put(leaf, device) if eqx.is_array(leaf) else leaf, layers)


def pictures(
    compared: Compared, layers: Layers, reference: np.ndarray | None, options: argparse.Namespace
) -> Iterator[Row]:
    """Ours, of every number of rays."""
    lens = compared[2]
    gpu, cpu = jax.devices()[0], jax.devices("cpu")[0]
    there, here = on(gpu, layers), on(cpu, layers)
    for rays in options.rays:
        found, row = measured(lambda n=rays: render(there, lens, rays=n), options.repeats)
        shown = np.asarray(found)
        if reference is not None:
            row["psnr"] = psnr(shown, reference)
        if gpu.platform != "cpu":
            with jax.default_device(cpu):
                begun = time.perf_counter()
                other = np.asarray(render(here, lens, rays=rays))
                row["processor's first s"] = time.perf_counter() - begun
            row["rms from the processor's"] = float(np.sqrt(np.mean((shown - other) ** 2)))
        yield {"what": "picture", "rays": rays, **row}
    yield from derivatives(there, lens, options)
    lenses = [
        eqx.tree_at(
            lambda a: a.aperture_radius, lens, lens.aperture_radius * (0.5 + 0.5 * n / options.lenses)
        )
        for n in range(options.lenses)
    ]
    _, row = measured(lambda: [render(there, each, rays=16) for each in lenses], 1)
    yield {"what": f"{options.lenses} lenses, 16 rays", **row, "ms each": row["ms"] / options.lenses}
    for rays in options.rays if options.profile else ():
        for row in costs(lambda n=rays: render(there, lens, rays=n), options.profile):
            yield {"rays": rays, **row}


def derivatives(layers: Layers, lens: ThinLens, options: argparse.Namespace) -> Iterator[Row]:
    """A loss of the picture and its gradient by the lens."""

    @eqx.filter_jit
    def slope(layers: Layers, lens: ThinLens) -> Any:
        def loss(lens: ThinLens) -> jax.Array:
            return jnp.mean(render(layers, lens, rays=16) ** 2)

        return eqx.filter_value_and_grad(loss)(lens)

    (_, gradient), row = measured(lambda: slope(layers, lens), options.repeats)
    yield {
        "what": "value and gradient",
        "rays": 16,
        **row,
        "by focus": float(gradient.focus_disparity),
        "by aperture": float(gradient.aperture_radius),
    }


def costs(run: Callable[[], Any], most: int) -> Iterator[Row]:
    """Which kernels of the device take longest."""
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            jax.block_until_ready(run())
        (path,) = Path(folder).rglob("*.xplane.pb")
        data = jax.profiler.ProfileData.from_file(str(path))
    total: dict[str, list[float]] = {}
    for plane in data.planes:
        if "GPU" not in plane.name:
            continue
        for line in plane.lines:
            if not line.name.startswith("Stream"):
                continue
            for event in line.events:
                stats = dict(event.stats)
                name = f"{stats.get('hlo_op', '')} {event.name[:60]}"
                total.setdefault(name, []).append(event.duration_ns / 1e6)
    yield {"what": "kernels", "ms": sum(map(sum, total.values())), "launches": sum(map(len, total.values()))}
    for name, spent in sorted(total.items(), key=lambda item: -sum(item[1]))[:most]:
        yield {"what": f"kernel {name}", "ms": sum(spent), "launches": len(spent)}


def path_traced(
    compared: Compared, reference: np.ndarray | None, options: argparse.Namespace
) -> Iterator[Row]:
    """Mitsuba's cuda variant, with scene and camera prepared and pictures left on the device."""
    import drjit
    import mitsuba

    mitsuba.set_variant("cuda_ad_rgb")
    from focusjax.baselines import load_unlit, thin_lens_sensor, unlit_scene

    scene, camera, lens = compared
    unlit = unlit_scene(scene)
    begun = time.perf_counter()
    loaded = load_unlit(unlit, "cuda_ad_rgb")
    drjit.sync_thread()
    yield {"what": "mitsuba's mesh and tree", "s": time.perf_counter() - begun}
    sensor = thin_lens_sensor(camera, lens, variant="cuda_ad_rgb")
    for samples in options.samples:

        def run(samples: int = samples) -> Any:
            made = mitsuba.render(loaded, sensor=sensor, integrator=loaded.integrator(), spp=samples)
            drjit.eval(made)
            drjit.sync_thread()
            return made

        found, row = measured(run, options.repeats)
        if reference is not None:
            shown = np.array(found)[..., -3:] + np.asarray(unlit.background)
            row["psnr"] = psnr(shown, reference)
        yield {"what": "mitsuba", "samples": samples, **row}


def times_as_quick(rows: list[Row]) -> Iterator[Row]:
    """Of each number of rays, to its own error, by a scene's rows."""
    theirs = [(row["ms"], row["psnr"]) for row in rows if row["what"] == "mitsuba" and "psnr" in row]
    for row in rows:
        if theirs and row["what"] == "picture":
            reach = time_to_reach(theirs, row["psnr"])
            yield {"what": "times as quick", "rays": row["rays"], "times": reach.seconds / row["ms"]}


def measure(options: argparse.Namespace) -> Iterator[Row]:
    """All lines, as they come."""
    about = machine()
    yield {"what": "device", **about}
    for name in options.scenes:
        compared = SCENES[name]()
        with jax.default_device(jax.devices("cpu")[0]):
            layers = peel(*compared, supersampling=options.supersampling, max_layers=options.max_layers)
        reference = None
        if options.cache is not None:
            case = Case(name, name, *compared, 16)
            made = reference_picture(case, maker="mitsuba", samples=1024, cache=options.cache)
            reference = made.picture
        yield {"scene": name, "what": "peeled", "layers": layers.filled, "complete": layers.complete}
        rows = []
        for row in pictures(compared, layers, reference, options):
            rows.append(row)
            yield {"scene": name, **row}
        memory = (jax.devices()[0].memory_stats() or {}).get("peak_bytes_in_use", 0)
        yield {"scene": name, "what": "memory", "peak MiB": memory / 2**20}
        if any(options.samples):
            try:
                for row in path_traced(compared, reference, options):
                    rows.append(row)
                    yield {"scene": name, **row}
            except (ImportError, ValueError, RuntimeError) as error:
                yield {"scene": name, "what": "mitsuba", "error": " ".join(str(error).split())[:300]}
        for row in times_as_quick(rows):
            yield {"scene": name, **row}


def main() -> None:
    options, rows = arguments(), []
    for row in measure(options):
        rows.append(row)
        print(json.dumps(row), flush=True)
        write_json(options.json, rows)


if __name__ == "__main__":
    main()
