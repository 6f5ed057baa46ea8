"""How even the out-of-focus discs of small lamps are, by rays per pixel.

A lamp of 3 x 3 pixels far behind the focus becomes a picture of the aperture, about 40 pixels wide. Within it
every pixel has about the same light, a quadratic function of its place; what differs from that is noise. The
table has its standard deviation over the mean, in per cent, and the whole disc's light over that of the lamp.
Of a config, the lights that show: pixels that get most of their light from emitters, and how far they differ
from seed to seed.

    python scripts/disc_grain.py
    python scripts/disc_grain.py --only thin --config configs/still_life.toml --size 320 240
    python scripts/disc_grain.py --rays 16 64 --out out/grain
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, write_json
from _shapes import shining
from rich.console import Console
from rich.table import Table

from focusjax.bench._case import resized
from focusjax.config import build_scene, load_config
from focusjax.geometry import Camera, look_at
from focusjax.io import save_png
from focusjax.job import run
from focusjax.layers import peel
from focusjax.lens import AbstractLens, ThinLens, polygon, prescription_lens, tilt_shift_lens
from focusjax.optics import lens_preset
from focusjax.scene import Scene, constant_background, make_scene
from focusjax.trace import render
from focusjax.trace._emitters import split_emitters

WIDTH, HEIGHT = 160, 120
LENGTH, SENSOR, FOCUS, FAR = 0.05, 0.005, 1.0, 4.0
"""Metres: focal length, width of the sensor, focus distance, and distance of the lamp."""
RADIUS = 20.0
"""Pixels, of the disc."""
SIZE, LIGHT, DARK = 3.0, 100.0, 0.02
LEAST_LIGHT = 0.2
"""Radiance from which pixels of a config are looked at."""
WITHIN = 0.8
"""Share of the disc's radius in which its grain is measured."""


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--rays", type=int, nargs="+", default=[16, 64, 256], help="per pixel")
    parser.add_argument("--only", nargs="*", choices=list(LENSES), default=list(LENSES), help="some")
    parser.add_argument("--supersampling", type=int, default=2, help="samples of layers per pixel")
    parser.add_argument("--config", type=Path, nargs="*", default=[], help="scenes with small lights")
    parser.add_argument("--size", type=int, nargs=2, default=[320, 240], help="of their pictures, in pixels")
    parser.add_argument("--out", type=Path, help="folder for pictures and grain.json")
    return parser.parse_args()


def camera() -> Camera:
    return look_at(
        (0, 0, 0), (0, 0, -1), width=WIDTH, height=HEIGHT, focal_length=LENGTH, sensor_width=SENSOR
    )


def radius_of_aperture() -> float:
    """Metres, for discs of the wanted size."""
    return RADIUS / (float(camera().focal_px) * (1 / FOCUS - 1 / FAR))


def thin(blades: int | None = None) -> Callable[[], AbstractLens]:
    def lens() -> AbstractLens:
        shape = {} if blades is None else {"aperture": polygon(blades, roundness=0.6)}
        return ThinLens(jnp.array(1 / FOCUS), jnp.array(radius_of_aperture()), **shape)

    return lens


def glass() -> AbstractLens:
    lens = lens_preset("gauss_jp62087922_f1.8_1987")
    return prescription_lens(lens, camera(), focus_distance=FOCUS)


def tilted() -> AbstractLens:
    return tilt_shift_lens(
        focus_distance=FOCUS, focal_length=LENGTH, tilt=0.05, aperture_radius=radius_of_aperture()
    )


LENSES = {"thin": thin(), "nine blades": thin(9), "tilted": tilted, "glass": glass}


def lamp() -> Scene:
    """In the middle, between pixels, before a dark wall."""

    def card(name: str, half: float, distance: float, radiance: float):
        x = half * distance / float(camera().focal_px)
        corners = np.array([(-x, x, -distance), (x, x, -distance), (x, -x, -distance), (-x, -x, -distance)])
        return shining(name, corners, radiance)

    return make_scene(
        [card("lamp", SIZE / 2, FAR, LIGHT), card("wall", 4 * WIDTH, 1.01 * FAR, DARK)],
        background=constant_background(0.0),
        unlit=True,
    )


def grain_of(picture: np.ndarray, radius: float) -> tuple[float, float]:
    """Grain within the disc over the mean there, and the disc's light over the lamp's, in per cent."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    light = picture[..., 1] - DARK
    away = np.hypot(x - WIDTH / 2, y - HEIGHT / 2)
    within = away < WITHIN * radius
    x, y = x[within] - WIDTH / 2, y[within] - HEIGHT / 2
    smooth = np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)
    inside = light[within]
    grain = inside - smooth @ np.linalg.lstsq(smooth, inside, rcond=None)[0]
    energy = light[away < 2 * radius].sum() / ((LIGHT - DARK) * SIZE**2)
    return 100 * float(grain.std() / inside.mean()), 100 * float(energy)


def radius_of(picture: np.ndarray) -> float:
    """Pixels, by the area that is at least half as bright as the middle."""
    light = picture[..., 1] - DARK
    middle = np.median(light[HEIGHT // 2 - 3 : HEIGHT // 2 + 3, WIDTH // 2 - 3 : WIDTH // 2 + 3])
    return math.sqrt((light > 0.5 * middle).sum() / math.pi)


def grain_of_config(path: Path, size: tuple[int, int], rays: int) -> tuple[float, np.ndarray]:
    """Root mean square, in per cent of its mean, of what differs between seeds where emitters are seen."""
    config = load_config(path)
    outcome = run(config, rendering=False)
    camera, lens = resized(outcome.camera, *size), outcome.lens
    layers = peel(build_scene(config), camera, lens, supersampling=2)
    pictures = [np.asarray(render(layers, lens, rays=rays, smooth=False, seed=seed)) for seed in (0, 1)]
    left = split_emitters(layers, lens)[0]
    plain = np.asarray(render(left, lens, rays=rays, smooth=False))
    mean = 0.5 * (pictures[0] + pictures[1])
    lit = (mean.max(axis=-1) > LEAST_LIGHT) & (mean.sum(axis=-1) > 2.0 * plain.sum(axis=-1))
    difference = (pictures[0] - pictures[1])[lit].sum(axis=-1) / mean[lit].sum(axis=-1)
    return 100 * float(np.sqrt((difference**2).mean() / 2)), pictures[0]


def main() -> None:
    options, console = arguments(), Console()
    table = Table("lens", "rays", "radius px", "grain %", "light %", title="Discs of small lamps")
    found = []
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only:
        lens = LENSES[name]()
        layers = peel(lamp(), camera(), lens, supersampling=options.supersampling)
        for rays in options.rays:
            picture = np.asarray(render(layers, lens, rays=rays, smooth=False))
            radius = radius_of(picture)
            grain, light = grain_of(picture, radius)
            found.append({"lens": name, "rays": rays, "radius_px": radius, "grain": grain, "light": light})
            table.add_row(name, str(rays), f"{radius:.1f}", f"{grain:.2f}", f"{light:.2f}")
            if options.out is not None:
                save_png(options.out / f"{name.replace(' ', '_')}_{rays}.png", picture)
    for path in options.config:
        for rays in options.rays:
            grain, picture = grain_of_config(path, options.size, rays)
            found.append({"config": path.stem, "rays": rays, "grain": grain})
            table.add_row(path.stem, str(rays), "", f"{grain:.2f}", "")
            if options.out is not None:
                save_png(options.out / f"{path.stem}_{rays}.png", picture)
    if options.out is not None:
        write_json(options.out / "grain.json", found)
    console.print(table)


if __name__ == "__main__":
    main()
