"""Motion and defocus together: error against many accumulated times, seconds beside a picture of one instant.

Spot, lit and textured, crosses the picture and turns while the shutter is open, before a wall of small
squares that is out of focus. The reference is the mean of sharp times, each with lens samples of its own, by
Embree, which shares nothing with layers or tracer: 256 times of 64 samples.

    python scripts/bench_motion.py --cache out/motion.npy
    python scripts/bench_motion.py --derivative
    python scripts/bench_motion.py --lamps

With `--lamps` it is fourteen lamps out of focus, 40 to 90 times as bright as white, behind a card in focus,
while the camera moves; the reference is the mean of two pictures of 512 rays, of other seeds.
"""

import argparse
import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from _command_line import kept, make_parser
from _shapes import shining, squares
from _timing import Timed, timed
from gradient_study import in_blocks
from rich.console import Console
from rich.table import Table

from focusjax.baselines import lens_picture
from focusjax.geometry import Camera, look_at
from focusjax.io import save_png
from focusjax.layers import peel
from focusjax.lens import ThinLens, thin_lens
from focusjax.metrics import psnr
from focusjax.scene import SceneObject, directional_light, load_mesh, make_object, make_scene, placement
from focusjax.shot import Motion, MovingScene, transforms
from focusjax.shutter import make_shutter, render_moving
from focusjax.trace import render

MESHES = Path(__file__).parents[1] / "configs" / "meshes"
FPS = 24.0


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--size", nargs=2, type=int, default=[160, 120], help="width and height in pixels")
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--way", type=float, default=0.08, help="metres that she goes")
    parser.add_argument("--turn", type=float, default=60.0, help="degrees that she turns")
    parser.add_argument("--f-number", type=float, default=2.0)
    parser.add_argument("--focus", type=float, default=0.6, help="metres")
    parser.add_argument("--turns", nargs="+", type=float, default=[0.1, 0.2, 0.4, 0.8], help="radians")
    parser.add_argument("--discrete", nargs="*", type=int, default=[4, 16, 64], help="sharp times averaged")
    parser.add_argument("--times", type=int, default=256, help="of the reference")
    parser.add_argument("--views", type=int, default=64, help="lens samples of each of its times")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--cache", type=Path, help="file that keeps the reference")
    parser.add_argument("--out", type=Path, help="folder for pictures")
    parser.add_argument("--as-traced", action="store_true", help="smooth nothing")
    parser.add_argument("--derivative", action="store_true", help="compare a derivative with differences")
    parser.add_argument("--lamps", action="store_true", help="lamps before a moving camera")
    return parser.parse_args()


def wall(count: int = 24) -> SceneObject:
    """Squares of all colours."""
    colours = np.random.default_rng(0).uniform(0.05, 0.9, (count**2, 3))
    column, row, faces = squares(count, count)
    x, y = column / count * 1.6 - 0.8, row / count * 1.2 - 0.6
    points = np.stack([x, y, np.full_like(x, -0.6)], axis=-1).reshape(-1, 3)
    return make_object("wall", points, faces, vertex_colours=np.repeat(colours, 4, axis=0))


def passing_spot(options: argparse.Namespace) -> tuple[MovingScene, Camera, ThinLens]:
    """She goes and turns from frame 0 to 2, which is how long the shutter is open."""
    place = {"translate": (0.0, 0.06, 0.0), "rotate": (0.0, 160.0, 0.0), "scale": 0.08}
    spot = load_mesh(MESHES / "spot.glb", name="spot", **place)
    objects = [spot, wall()]
    scene = make_scene(objects, ambient=0.3, lights=[directional_light((-1, -2, -1))])
    ends = {
        frame: {
            "translate": (side * options.way / 2, 0.06, 0.0),
            "rotate": (0.0, 160.0 + side * options.turn / 2, 0.0),
            "scale": 0.08,
        }
        for frame, side in ((0.0, -1), (2.0, 1))
    }
    motion = Motion(
        placement(place["translate"], place["rotate"], place["scale"]), transforms(ends, between="linear")
    )
    width, height = options.size
    camera = look_at((0, 0.1, 0.6), (0, 0.05, 0), width=width, height=height, focal_length=0.05)
    lens = thin_lens(focus_distance=options.focus, f_number=options.f_number, focal_length=0.05)
    return MovingScene(scene, objects, {"spot": motion}), camera, lens


def reference(options: argparse.Namespace, world: MovingScene, camera: Camera, lens: ThinLens) -> np.ndarray:
    """The mean of many sharp times."""

    def mean() -> np.ndarray:
        total = np.zeros((camera.height, camera.width, 3))
        for number in range(options.times):
            scene = world.at(2.0 * (number + 0.5) / options.times)
            total += lens_picture(scene, camera, lens, rays=options.views, seed=number)
        return total / options.times

    return kept(options.cache, mean)


def mean_of_times(world: MovingScene, camera: Camera, lens: ThinLens, count: int, rays: int) -> np.ndarray:
    """What a renderer of sharp times does with as many rays in all: some at each of a few times."""
    layers, total = None, np.zeros((camera.height, camera.width, 3))
    for number in range(count):
        layers = peel(world.at(2.0 * (number + 0.5) / count), camera, lens, like=layers)
        total += np.asarray(render(layers, lens, rays=max(1, rays // count), even=True, seed=number)) / count
    return total


def derivative(world: MovingScene, camera: Camera, lens: ThinLens, console: Console) -> None:
    """By the focus, of a picture of few times, against differences of it."""
    layers = [peel(world.at(2.0 * (number + 0.5) / 4), camera, lens) for number in range(4)]

    @eqx.filter_jit
    def picture(focus):
        moved = eqx.tree_at(lambda lens: lens.focus_disparity, lens, focus)
        return sum(render(each, moved, even=True, rays=256) for each in layers) / 4

    focus, step = lens.focus_disparity * 0.9, 0.02
    change = jax.jvp(picture, (focus,), (jnp.ones_like(focus),))[1]
    difference = (picture(focus + step) - picture(focus - step)) / (2 * step)
    blocks = [in_blocks(np.asarray(each)) for each in (change, difference)]
    projection = float((blocks[0] * blocks[1]).sum() / (blocks[1] ** 2).sum())
    console.print(f"derivative by the focus, over 8 x 8 pixels: projection {projection:.3f}")


def quad(name: str, middle: np.ndarray, size: float, radiance: np.ndarray) -> SceneObject:
    """A square that looks along z and shines."""
    corners = middle + 0.5 * size * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    return shining(name, corners, radiance)


def lamps(options: argparse.Namespace, console: Console) -> None:
    """Error and seconds of lamps before a camera that moves, and of the same at one instant."""
    random, (width, height) = np.random.default_rng(3), options.size
    camera = look_at((0, 0, 0), (0, 0, -1), width=width, height=height, focal_length=0.05)
    objects = [quad("wall", np.array([0, 0, -11.0]), 40.0, np.array([0.1, 0.12, 0.15]))]
    objects += [quad("card", np.array([-0.02, -0.05, -1.0]), 0.15, np.array([0.3, 0.2, 0.1]))]
    for number in range(14):
        depth = random.uniform(3.0, 10.0)
        across = random.uniform(-0.25, 0.25, 2) * (1.0, height / width) * depth
        radiance = random.uniform(40.0, 90.0, 3)
        objects.append(quad(f"lamp {number}", np.append(across, -depth), 0.006 * depth, radiance))
    scene = make_scene(objects, unlit=True)
    lens = thin_lens(focus_distance=1.0, f_number=options.f_number / 2.0, focal_length=0.05)

    def path(frame: float) -> Camera:
        pose = camera.world_from_camera.at[:2, 3].add(0.3 * (frame - 1.0) * jnp.array([1.0, -0.4]))
        return dataclasses.replace(camera, world_from_camera=pose)

    def taken(rays: int, seed: int = 0):
        return render_moving(scene, path, lens, make_shutter(1.0), fps=1.0, rays=rays, seed=seed)

    layers = peel(scene, camera, lens)
    truth = np.mean([np.asarray(taken(512, seed).image) for seed in (1, 2)], axis=0)
    instant = np.mean([np.asarray(render(layers, lens, rays=512, seed=seed)) for seed in (1, 2)], axis=0)
    table = Table("rays", "moving", "seconds with peeling", "one instant", "seconds")
    for rays in (16, 64, 256):
        found = timed(lambda rays=rays: taken(rays), options.repeats)
        still = timed(lambda rays=rays: render(layers, lens, rays=rays), options.repeats)
        moving = found.result
        table.add_row(
            str(rays),
            f"{psnr(np.asarray(moving.image), truth):.1f} dB",
            f"{found.median:.2f}",
            f"{psnr(np.asarray(still.result), instant):.1f} dB",
            f"{still.median:.2f}",
        )
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            save_png(options.out / f"lamps_{rays}.png", np.asarray(moving.image))
    console.print(f"{moving.spans} spans", table)


def main() -> None:
    options, console = arguments(), Console()
    if options.lamps:
        lamps(options, console)
        return
    world, camera, lens = passing_spot(options)
    if options.derivative:
        derivative(world, camera, lens, console)
        return
    truth = reference(options, world, camera, lens)
    shutter = make_shutter(2.0 / FPS)

    def still():
        return render(
            peel(world.at(1.0), camera, lens), lens, rays=options.rays, smooth=not options.as_traced
        )

    instant = timed(still, options.repeats)
    table = Table(
        "picture", "times peeled", "PSNR", "where it moves", "seconds", "times one instant", "by processor"
    )
    table.add_row("one instant", "1", "", "", f"{instant.median:.2f}", "1", "1")
    moving: np.ndarray | None = None

    def add(name: str, peels: int, image: np.ndarray, spent: Timed) -> None:
        assert moving is not None
        table.add_row(
            name,
            str(peels),
            f"{psnr(image, truth):.1f} dB",
            f"{psnr(image, truth, mask=moving):.1f} dB",
            f"{spent.median:.2f}",
            f"{spent.median / instant.median:.2f}",
            f"{spent.cpu_median / instant.cpu_median:.2f}",
        )
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            save_png(options.out / f"{name.replace(' ', '_')}.png", image)

    for turn in options.turns:

        def run(turn: float = turn):
            return render_moving(
                world,
                camera,
                lens,
                shutter,
                frame=1.0,
                fps=FPS,
                rays=options.rays,
                smooth=not options.as_traced,
                turn=turn,
            )

        spent = timed(run, options.repeats)
        found = spent.result
        if moving is None:
            still_picture = lens_picture(world.at(1.0), camera, lens, rays=16)
            moving = np.abs(truth - still_picture).max(axis=-1) > 0.1
            console.print(
                f"{found.motion_px:.0f} px of motion, {found.changing:.0%} of the pixels traced with times"
            )
        add(f"rays with times, turn {turn:g}", found.peels, np.asarray(found.image), spent)
    for count in options.discrete:

        def run_discrete(count: int = count):
            return mean_of_times(world, camera, lens, count, options.rays)

        spent = timed(run_discrete, 1)
        add(f"mean of {count} sharp times", count, spent.result, spent)
    if options.out is not None:
        save_png(options.out / "reference.png", truth)
    console.print(table)


if __name__ == "__main__":
    main()
