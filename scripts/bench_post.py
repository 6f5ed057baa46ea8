"""Post-processing against tracing: seconds and error of each effect of the camera, alone and together.

The truth of each row is the picture traced with many rays through the same lens over the same layers; of
motion, the mean of sharp pictures along the way. Beside it stands the tracer with few rays. The scene is that
of `focusjax bench speed-error`, no brighter than white, unless its lights are kept. Seconds are of
process time (all cores), programs being compiled; `view` and `peel` are what each needs before. What is
printed goes to post.json, the pictures beside it.

    python scripts/bench_post.py --out out/post
    python scripts/bench_post.py --out out/post --width 320 --only defocus all
"""

import argparse
import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from focusjax.bench import baked, resized
from focusjax.config import build_camera, build_scene, load_config
from focusjax.geometry import Camera
from focusjax.io import save_png
from focusjax.layers import Layers, peel
from focusjax.lens import (
    AberratedLens,
    AbstractLens,
    DarkenedLens,
    chromatic_lens,
    cosine_falloff,
    lens_profile,
    power_profile,
    profiled_lens,
    seidel,
    thin_lens,
    vignetted_lens,
)
from focusjax.post import PinholeView, post_process, view_in_layers
from focusjax.scene import Scene
from focusjax.trace import render, render_pinhole

FOCAL, FOCUS = 0.05, 0.6
STEPS = 33
"""Sharp pictures along a motion."""
MOVE = 0.02
"""Metres that the camera goes to the side."""


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for post.json and the pictures")
    parser.add_argument("--config", type=Path, default=Path("configs/still_life.toml"))
    parser.add_argument("--width", type=int, default=640, help="pixels; the height is three quarters of it")
    parser.add_argument("--taps", type=int, default=32)
    parser.add_argument("--rays", type=int, nargs="+", default=[4, 8, 16, 32])
    parser.add_argument("--truth", type=int, default=1024, help="rays per pixel of the truth")
    parser.add_argument("--lights", action="store_true", help="keep lights brighter than white, and shading")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=[*EFFECTS, "motion"], default=[*EFFECTS, "motion"])
    return parser.parse_args()


def small(camera: Camera) -> AbstractLens:
    """Nearly a pinhole, for what is not blur."""
    return thin_lens(focus_distance=FOCUS, f_number=64, focal_length=float(camera.focal_length))


def large(camera: Camera, f_number: float = 2.0) -> AbstractLens:
    return thin_lens(focus_distance=FOCUS, f_number=f_number, focal_length=float(camera.focal_length))


def with_terms(lens: AbstractLens, camera: Camera, **shares: float) -> AbstractLens:
    """Seidel terms in shares of the picture's width."""
    terms = {name: share * camera.width for name, share in shares.items()}
    return AberratedLens(lens, (seidel(lens, camera, **terms),))


EFFECTS: dict[str, Callable[[Camera], AbstractLens]] = {
    "defocus": large,
    "spherical": lambda camera: AberratedLens(large(camera), (power_profile([0.0, 0.3]),)),
    "astigmatism": lambda camera: with_terms(large(camera), camera, w222=0.01, w220=-0.005),
    "coma": lambda camera: with_terms(large(camera), camera, w131=0.005),
    "distortion": lambda camera: with_terms(small(camera), camera, w311=0.02),
    "lateral colour": lambda camera: chromatic_lens(small(camera), magnification=(1.006, 1.0, 0.994)),
    "vignetting": lambda camera: vignetted_lens(
        DarkenedLens(small(camera), cosine_falloff()), camera, corner_shift=0.8
    ),
    "all": lambda camera: profiled_lens(large(camera), lens_profile("gauss_f1.8"), camera),
}


def decibels(picture: Any, truth: np.ndarray) -> float:
    """PSNR for a peak of 1; what is brighter counts relative to itself, as in `estimate_quality`."""
    error = (np.asarray(picture) - truth) / np.maximum(truth, 1.0)
    return float(-10.0 * np.log10(np.mean(error**2)))


def timed(run: Callable[[], Any], repeats: int) -> tuple[Any, float, float]:
    """What it makes, and the least process and wall-clock seconds of some calls after the first."""
    made, spent = jax.block_until_ready(run()), []
    for _ in range(repeats):
        process, wall = time.process_time(), time.perf_counter()
        made = jax.block_until_ready(run())
        spent.append((time.process_time() - process, time.perf_counter() - wall))
    return made, min(each for each, _ in spent), min(each for _, each in spent)


def layers_of(scene: Scene, camera: Camera, lens: AbstractLens) -> Layers:
    layers = peel(scene, camera, lens, supersampling=2)
    jax.block_until_ready(eqx.filter(layers, eqx.is_array))
    return layers


def moved(camera: Camera, share: float) -> Camera:
    """The camera a part of its way to the side."""
    pose = camera.world_from_camera
    place = pose[:3, 3] + (share * MOVE) * pose[:3, 0]
    return dataclasses.replace(camera, world_from_camera=pose.at[:3, 3].set(place))


def motion(scene: Scene, camera: Camera) -> tuple[np.ndarray, PinholeView]:
    """The mean of sharp pictures, and the view in the middle with its velocities."""
    closed = thin_lens(focus_distance=FOCUS, aperture_radius=0.0)
    total: Any = 0.0
    for share in (np.arange(STEPS) + 0.5) / STEPS - 0.5:
        total = total + np.asarray(render_pinhole(layers_of(scene, moved(camera, float(share)), closed)))
    view = view_in_layers(layers_of(scene, camera, closed), scene)
    # To the right, things go to the left.
    along = -camera.focal_px * MOVE * view.disparity
    velocity = jnp.stack([along, jnp.zeros_like(along)], axis=-1)
    return total / STEPS, dataclasses.replace(view, velocity=velocity)


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    config = load_config(options.config)
    scene = build_scene(config) if options.lights else baked(build_scene(config))
    camera = resized(build_camera(config), options.width, options.width * 3 // 4)
    closed = thin_lens(focus_distance=FOCUS, aperture_radius=0.0)

    def sharp() -> PinholeView:
        return view_in_layers(layers_of(scene, camera, closed), scene)

    view, seconds, wall = timed(sharp, options.repeats)
    results: dict[str, Any] = {"size": [camera.width, camera.height], "view": {"cpu": seconds, "wall": wall}}
    print(f"view: {seconds:.2f} s of CPU", flush=True)
    for name in options.only:
        rows: list[dict[str, Any]] = []
        if name == "motion":
            truth, moving = motion(scene, camera)
            still = dataclasses.replace(view, velocity=None)
            found, seconds, wall = timed(
                lambda moving=moving: post_process(moving, camera, closed), options.repeats
            )
            rows.append({"way": "post", "cpu": seconds, "wall": wall, "db": decibels(found, truth)})
            rows.append({"way": "sharp view", "db": decibels(still.image, truth)})
        else:
            lens = EFFECTS[name](camera)
            layers, peeling, peeling_wall = timed(
                lambda lens=lens: layers_of(scene, camera, lens), options.repeats
            )
            truth = np.asarray(render(layers, lens, rays=options.truth, smooth=False, seed=7))
            found, seconds, wall = timed(
                lambda lens=lens: post_process(view, camera, lens, taps=options.taps), options.repeats
            )
            rows.append({"way": "post", "cpu": seconds, "wall": wall, "db": decibels(found, truth)})
            rows.append({"way": "sharp view", "db": decibels(view.image, truth)})
            rows.append({"way": "peel", "cpu": peeling, "wall": peeling_wall})
            for rays in options.rays:
                traced, seconds, wall = timed(
                    lambda rays=rays, layers=layers, lens=lens: render(layers, lens, rays=rays),
                    options.repeats,
                )
                rows.append(
                    {"way": f"{rays} rays", "cpu": seconds, "wall": wall, "db": decibels(traced, truth)}
                )
        results[name] = rows
        for row in rows:
            said = [f"{row['cpu']:.3f} s of CPU"] if "cpu" in row else []
            said += [f"{row['db']:.1f} dB"] if "db" in row else []
            print(f"{name}, {row['way']}: {', '.join(said)}", flush=True)
        pictures = [np.asarray(found), truth, 0.5 + 4.0 * (np.asarray(found) - truth)]
        save_png(options.out / f"{name.replace(' ', '_')}.png", np.concatenate(pictures, axis=1))
    (options.out / "post.json").write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
