"""Post-processing against tracing: seconds and error of each effect of the camera, alone and together.

The truth of each row is the picture traced with many rays through the same lens over the same layers; of
motion, the mean of sharp pictures along the way. Beside it stands the tracer with few rays. The scene is that
of `focusjax bench speed-error`, no brighter than white, unless its lights are kept. `outlines` are scenes
with blurred foregrounds instead, by post-processing and, as it was before that followed rays there, by
gathering alone; of three configs the lens is the solved one. Seconds are of
process time (all cores), programs being compiled; `view` and `peel` are what each needs before. What is
printed goes to post.json, the pictures beside it.

    python scripts/bench_post.py --out out/post
    python scripts/bench_post.py --out out/post --width 320 --only defocus all
    python scripts/bench_post.py --out out/post --width 320 --truth 256 --only outlines
"""

import argparse
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, write_json
from _shapes import shining, squares
from _timing import timed
from planner_study import decibels

from focusjax import job
from focusjax.bench import baked, resized
from focusjax.config import build_camera, build_look, build_scene, load_config
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
from focusjax.post import PinholeView, gather, post_process, view_in_layers
from focusjax.scene import Scene, SceneObject, make_object, make_scene
from focusjax.trace import render, render_pinhole

FOCAL, FOCUS = 0.05, 0.6
STEPS = 33
"""Sharp pictures along a motion."""
MOVE = 0.02
"""Metres that the camera goes to the side."""


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for post.json and the pictures")
    parser.add_argument("--config", type=Path, default=Path("configs/still_life.toml"))
    parser.add_argument("--width", type=int, default=640, help="pixels; the height is three quarters of it")
    parser.add_argument("--taps", type=int, default=32)
    parser.add_argument("--rays", type=int, nargs="+", default=[4, 8, 16, 32])
    parser.add_argument("--truth", type=int, default=1024, help="rays per pixel of the truth")
    parser.add_argument("--lights", action="store_true", help="keep lights brighter than white, and shading")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument(
        "--only", nargs="+", choices=[*EFFECTS, "motion", "outlines"], default=[*EFFECTS, "motion"]
    )
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


def least(run: Callable[[], Any], repeats: int) -> tuple[Any, dict[str, float]]:
    """What it makes, and the least process and wall-clock seconds of some calls after the first."""
    found = timed(run, repeats)
    return found.result, {"cpu": min(found.cpu[1:]), "wall": min(found.wall[1:])}


def layers_of(scene: Scene, camera: Camera, lens: AbstractLens) -> Layers:
    return peel(scene, camera, lens, supersampling=2)


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


def before_a_wall(camera: Camera, lens_at: float) -> tuple[Scene, Camera, AbstractLens]:
    """A card and a bar close to the lens before a checkered wall 4 m away, focused at a distance."""
    columns, rows, faces = squares(80, 60)
    wall = np.stack([0.1 * (columns - 40), 0.1 * (rows - 30), np.full(rows.shape, -4.0)], axis=-1)
    checks = np.where((rows + columns)[:, :1] % 2, (0.25, 0.3, 0.45), (0.8, 0.75, 0.6))
    things = [
        make_object("wall", wall.reshape(-1, 3), faces, vertex_colours=np.repeat(checks, 4, axis=0)),
        _card("card", (-0.25, -0.12, 0.02, 0.14), 1.0, (0.9, 0.3, 0.1)),
        _card("bar", (0.16, -2.0, 0.2, 2.0), 0.8, (0.1, 0.1, 0.2)),
        _card("sign", (0.1, 0.1, 0.6, 0.4), 2.0, (0.2, 0.6, 0.3)),
    ]
    ahead = dataclasses.replace(camera, world_from_camera=jnp.eye(4))
    return make_scene(things, unlit=True), ahead, thin_lens(focus_distance=lens_at, aperture_radius=0.02)


def _card(name: str, box: tuple[float, ...], away: float, colour: tuple[float, float, float]) -> SceneObject:
    """An upright rectangle: left, bottom, right and top in metres, turned a little in its plane."""
    left, bottom, right, top = box
    corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    turned = corners @ np.array([(np.cos(0.1), np.sin(0.1)), (-np.sin(0.1), np.cos(0.1))])
    points = np.concatenate([turned, np.full((4, 1), -away)], axis=1)
    return shining(name, points, colour)


def foregrounds(camera: Camera, still: Scene) -> Iterator[tuple[str, Scene, Camera, AbstractLens]]:
    """Scenes with blurred foregrounds, with their lenses."""
    yield ("wall in focus", *before_a_wall(camera, 4.0))
    yield ("sign in focus", *before_a_wall(camera, 2.0))
    for distance in (1.8, FOCUS):
        lens = thin_lens(focus_distance=distance, f_number=2.0, focal_length=FOCAL)
        yield f"still life at {distance} m", still, camera, lens
    for name in ("bars", "town", "tilted_row"):
        config = load_config(Path("configs") / f"{name}.toml")
        solved = job.run(config, rendering=False)
        own = resized(solved.camera, camera.width, camera.height)
        yield name, build_scene(config), own, build_look(config, own, solved.lens)


def outlines(camera: Camera, still: Scene, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows of each scene with blurred foregrounds, and its pictures beside each other."""
    rows: list[dict[str, Any]] = []
    for name, scene, own, lens in foregrounds(camera, still):
        layers = peel(scene, own, lens, supersampling=1, max_layers=24)
        truth = np.asarray(render(layers, lens, rays=options.truth, smooth=False, seed=7))
        view = view_in_layers(layers, scene)
        shown = [truth]
        for way, run in (("gather", gathered), ("post", post_process)):
            made, spent = least(
                lambda run=run, view=view, own=own, lens=lens: run(view, own, lens, taps=options.taps),
                options.repeats,
            )
            shown += [np.asarray(made), 0.5 + 4.0 * (np.asarray(made) - truth)]
            rows.append({"way": f"{name}, {way}", **spent, "db": decibels(made, truth)})
        print(f"{name}: {rows[-2]['db']:.1f} dB gathered, {rows[-1]['db']:.1f} dB", flush=True)
        save_png(options.out / f"outlines_{name.replace(' ', '_')}.png", np.concatenate(shown, axis=1))
    return rows


def gathered(view: PinholeView, camera: Camera, lens: AbstractLens, *, taps: int) -> Any:
    return gather(view.image, view.disparity, camera, lens, taps=taps)


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    config = load_config(options.config)
    scene = build_scene(config) if options.lights else baked(build_scene(config))
    camera = resized(build_camera(config), options.width, options.width * 3 // 4)
    closed = thin_lens(focus_distance=FOCUS, aperture_radius=0.0)

    def sharp() -> PinholeView:
        return view_in_layers(layers_of(scene, camera, closed), scene)

    view, spent = least(sharp, options.repeats)
    results: dict[str, Any] = {"size": [camera.width, camera.height], "view": spent}
    print(f"view: {spent['cpu']:.2f} s of CPU", flush=True)
    for name in options.only:
        rows: list[dict[str, Any]] = []
        if name == "outlines":
            rows = outlines(camera, scene, options)
        elif name == "motion":
            truth, moving = motion(scene, camera)
            found, spent = least(lambda moving=moving: post_process(moving, camera, closed), options.repeats)
            rows.append({"way": "post", **spent, "db": decibels(found, truth)})
            rows.append({"way": "sharp view", "db": decibels(view.image, truth)})
        else:
            lens = EFFECTS[name](camera)
            layers, peeling = least(lambda lens=lens: layers_of(scene, camera, lens), options.repeats)
            truth = np.asarray(render(layers, lens, rays=options.truth, smooth=False, seed=7))
            found, spent = least(
                lambda lens=lens: post_process(view, camera, lens, taps=options.taps), options.repeats
            )
            rows.append({"way": "post", **spent, "db": decibels(found, truth)})
            rows.append({"way": "sharp view", "db": decibels(view.image, truth)})
            rows.append({"way": "peel", **peeling})
            for rays in options.rays:
                traced, spent = least(
                    lambda rays=rays, layers=layers, lens=lens: render(layers, lens, rays=rays),
                    options.repeats,
                )
                rows.append({"way": f"{rays} rays", **spent, "db": decibels(traced, truth)})
        results[name] = rows
        for row in rows:
            said = [f"{row['cpu']:.3f} s of CPU"] if "cpu" in row else []
            said += [f"{row['db']:.1f} dB"] if "db" in row else []
            print(f"{name}, {row['way']}: {', '.join(said)}", flush=True)
        if name == "outlines":
            continue
        pictures = [np.asarray(found), truth, 0.5 + 4.0 * (np.asarray(found) - truth)]
        save_png(options.out / f"{name.replace(' ', '_')}.png", np.concatenate(pictures, axis=1))
    write_json(options.out / "post.json", results)


if __name__ == "__main__":
    main()
