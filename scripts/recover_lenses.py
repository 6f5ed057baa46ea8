"""How well lenses are found again from pictures that an independent renderer made, noise left in.

For each config: true lenses and starts spread over the plausible range, and pictures of 256 rays per pixel,
by Mitsuba where it is installed and the lens is not turned, else by casting rays at the triangles (Embree). A
lens counts as found when its focus is within 0.5 % in disparity and its f-number within 2 %; with tilt and
swing free, when both are within 2 % and the angles within 0.1 degree.

    python scripts/recover_lenses.py --json results.json
    python scripts/recover_lenses.py --quick
"""

import argparse
import dataclasses
import importlib.util
import json
import math
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, make_table, write_json
from rich.console import Console
from scipy.stats import qmc

from focusjax.baselines import RayScene, lens_picture, mitsuba_picture, unlit_scene
from focusjax.bench import case_from_config
from focusjax.config import load_config
from focusjax.inverse import fit_image, scan_lenses, widest_lens
from focusjax.layers import peel
from focusjax.lens import ThinLens, TiltShiftLens, tilt_shift_lens

UPRIGHT = ("focus", "f_number")
TURNED = ("focus", "f_number", "tilt", "swing")
MOST_BLUR = 0.08
"""Of the picture's width: the widest blur of what is in sight, at the widest opening."""
STOPS = 3.0
"""By which openings differ at most."""
MOST_TILT = math.radians(4.0)
LIMITS = {UPRIGHT: (0.005, 0.02), TURNED: (0.02, 0.02)}
"""Relative errors of focus disparity and f-number."""
MOST_TURN = math.radians(0.1)


def spread(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Points of the unit cube, spread evenly."""
    points = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    return points.random_base2(math.ceil(math.log2(max(count, 2))))[:count]


def recover(path: Path, free: tuple[str, ...], options: argparse.Namespace) -> dict[str, object]:
    """Errors and seconds of all trials of one config."""
    case = case_from_config(load_config(path), (options.width, options.height))
    scene, camera = case.scene, case.camera
    first = peel(scene, camera, ThinLens(jnp.asarray(0.0), jnp.asarray(0.0)), supersampling=1, max_layers=1)
    margin = first.grid.margin
    seen = np.asarray(first.disparity)[0, margin : margin + camera.height, margin : margin + camera.width]
    least, most = np.quantile(seen[seen > 0], [0.02, 0.98])
    # The least f-number is the one that blurs the nearest or farthest by so much, focused on the other.
    radius = MOST_BLUR * camera.width / (2.0 * float(camera.focal_px) * max(most - least, 0.1 * most))
    length = float(camera.focal_length)
    smallest = length / (2.0 * radius)
    turned = "tilt" in free
    nearest = 1.0 / (1.3 * most)
    layers = peel(
        scene,
        camera,
        widest_lens(
            camera,
            min_focus_distance=nearest,
            f_number=smallest,
            max_tilt=math.sqrt(2) * MOST_TILT * turned,
        ),
        supersampling=options.supersampling,
        max_layers=case.max_layers,
    )

    def lens_at(point: np.ndarray) -> ThinLens | TiltShiftLens:
        focus = least + point[0] * (most - least)
        opening = radius * 2.0 ** (-STOPS / 2.0 * point[1])
        if not turned:
            return ThinLens(jnp.asarray(focus, dtype=float), jnp.asarray(opening, dtype=float))
        # As far as the scene is deep, so that the plane in focus passes through it.
        reach = length * (most - least) * float(camera.focal_px) / camera.width
        angle = min(MOST_TILT, math.asin(min(reach, 0.5)))
        tilt, swing = angle * (2.0 * point[2:4] - 1.0)
        return tilt_shift_lens(
            focus_distance=1.0 / focus, tilt=tilt, swing=swing, aperture_radius=opening, focal_length=length
        )

    by_mitsuba = not turned and importlib.util.find_spec("mitsuba") is not None
    cast = RayScene(scene)
    ready = unlit_scene(scene) if by_mitsuba else cast
    dimensions = 4 if turned else 2
    truths, starts = (spread(options.starts, dimensions, seed) for seed in (options.seed, options.seed + 1))
    begun = time.perf_counter()
    scan = scan_lenses(layers, lens_at(starts[0]), free=free)
    scanned = time.perf_counter() - begun
    trials = []
    for number, (truth, start) in enumerate(zip(truths, starts, strict=True)):
        true = lens_at(truth)
        if by_mitsuba:
            target = np.asarray(mitsuba_picture(ready, camera, true, samples=options.rays, seed=number + 1))
        else:
            target = lens_picture(ready, camera, true, rays=options.rays, seed=number + 1)

        def exact(lens: ThinLens | TiltShiftLens) -> np.ndarray:
            # Rays that no target is made of.
            return lens_picture(cast, camera, lens, rays=options.rays, seed=10_000)

        begun = time.perf_counter()
        fit = fit_image(
            target,
            layers,
            lens_at(start),
            free=free,
            search=not options.no_search,
            scan=scan,
            exact=None if options.no_exact else exact,
            rays=options.fit_rays,
            min_focus_distance=nearest,
        )
        trials.append(
            {
                "true": truth.tolist(),
                "start": start.tolist(),
                "seconds": time.perf_counter() - begun,
                "steps": fit.steps,
                "rms error": fit.rms_error,
                "at limits": fit.at_limits,
                **misses(fit.lens, true, camera),
            }
        )
        print(path.stem, number, json.dumps({k: v for k, v in trials[-1].items() if k != "true"}), flush=True)
    focus, opening = LIMITS[free]
    found = [t["focus"] <= focus and t["f-number"] <= opening and t["turn"] <= MOST_TURN for t in trials]
    return {
        "scene": path.stem,
        "free": list(free),
        "pictures by": "Mitsuba" if by_mitsuba else "Embree",
        "found": sum(found),
        "of": len(found),
        "scan seconds": scanned,
        "trials": trials,
    }


def misses(found: ThinLens | TiltShiftLens, true: ThinLens | TiltShiftLens, camera) -> dict[str, float]:
    """Relative errors of focus disparity and f-number, and the largest of tilt and swing in radians."""
    turn = 0.0
    if isinstance(true, TiltShiftLens):
        assert isinstance(found, TiltShiftLens)
        ours, theirs = dataclasses.asdict(found.movements(camera)), dataclasses.asdict(true.movements(camera))
        turn = max(abs(float(ours[name] - theirs[name])) for name in ("tilt", "swing"))
    return {
        "focus": abs(float(found.focus_disparity / true.focus_disparity) - 1.0),
        "f-number": abs(float(true.aperture_radius / found.aperture_radius) - 1.0),
        "turn": turn,
    }


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("configs", nargs="*", type=Path, help="bars, still_life and town by default")
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--height", type=int, default=120)
    parser.add_argument("--starts", type=int, default=20, help="true lenses, each with a start, per config")
    parser.add_argument("--rays", type=int, default=256, help="per pixel, of the pictures to fit")
    parser.add_argument("--fit-rays", type=int, default=64, help="per pixel, of the fit")
    parser.add_argument("--supersampling", type=int, default=4, help="layer samples per pixel and axis")
    parser.add_argument("--no-search", action="store_true", help="from the start alone")
    parser.add_argument("--no-exact", action="store_true", help="by pictures of the layers alone")
    parser.add_argument("--only", choices=["upright", "turned"], help="one of the two sets of parameters")
    parser.add_argument("--seed", type=int, default=0, help="of the true lenses")
    parser.add_argument("--quick", action="store_true", help="two starts, 96 x 72 pixels, one config")
    parser.add_argument("--json", type=Path, help="file for the results")
    options = parser.parse_args()
    folder = Path(__file__).parent.parent / "configs"
    names = ("bars", "still_life", "town")
    if options.quick:
        options.width, options.height, options.starts, names = 96, 72, 2, ("still_life",)
    chosen = {"upright": [UPRIGHT], "turned": [TURNED], None: [UPRIGHT, TURNED]}[options.only]
    paths = options.configs or [folder / f"{name}.toml" for name in names]
    results = [recover(path, free, options) for free in chosen for path in paths]
    title = f"{options.width} x {options.height}, {options.rays} rays, {options.fit_rays} to fit"
    headings = ("scene", "free", "pictures by", "found", "focus %", "f-number %", "turn °", "s")
    table = make_table(title, *headings, left=3)
    for row in results:
        median = {
            key: float(np.median([trial[key] for trial in row["trials"]]))
            for key in ("focus", "f-number", "turn", "seconds")
        }
        table.add_row(
            str(row["scene"]),
            ", ".join(row["free"]),
            str(row["pictures by"]),
            f"{row['found']} of {row['of']}",
            f"{100 * median['focus']:.3f}",
            f"{100 * median['f-number']:.2f}",
            f"{math.degrees(median['turn']):.3f}",
            f"{median['seconds']:.1f}",
        )
    Console(width=max(120, Console().width)).print(table)
    print("Errors and seconds are medians; the first fit of each size compiles its programs.")
    write_json(options.json, results)


if __name__ == "__main__":
    main()
