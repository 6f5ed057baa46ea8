"""The look of lenses: bokeh of every kind of lens without glass, behind the focus and before it.

Rows are lenses. On the left a night scene: small lights far behind the focus, others close to the lens, and
a row of bars in focus. On the right three of its lights, enlarged: behind the focus in the middle, before it,
and behind it in the corner. What a photographer might ask for goes to gallery.json: how bright the inner half
of each disc is against the outer half, and how much light the corner gets. gallery.png holds all, sheet.jpg
the three lights of each lens with its name.

    python scripts/bokeh_gallery.py --out out/bokeh
    python scripts/bokeh_gallery.py --out out/bokeh --only thin apodized --rays 256
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from _command_line import make_parser, write_json
from _shapes import in_world, shining
from _sheets import save_sheet
from scipy.ndimage import zoom

from focusjax.geometry import Camera, look_at
from focusjax.io import save_png
from focusjax.layers import peel
from focusjax.lens import (
    AberratedLens,
    AbstractAperture,
    AbstractLens,
    Disk,
    apodized,
    chromatic_lens,
    mask,
    obstructed,
    polygon,
    power_profile,
    seidel,
    squeezed,
    thin_lens,
    vignetted_lens,
)
from focusjax.scene import Scene, SceneObject, constant_background, make_scene
from focusjax.trace import render

WIDTH, HEIGHT = 360, 240
FOCUS, FAR, NEAR = 2.0, 40.0, 1.03
"""Metres. Lights behind and before the focus are blurred over the same number of pixels."""
PLACES = {"behind": (210.0, 84.0), "before": (165.0, 205.0), "corner": (330.0, 24.0)}
"""Lights to look at closely."""
WINDOW = 56
DARK = np.array([0.012, 0.013, 0.02])
BRIGHT = 28.0
"""So that a disc is about half as bright as white."""
TINTS = np.array([(1.0, 0.72, 0.4), (0.9, 0.9, 0.9), (0.9, 0.9, 0.9), (0.5, 0.75, 1.0)])
"""Of lights in turn; those that are looked at closely are white."""


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for gallery.png and gallery.json")
    parser.add_argument("--only", nargs="+", choices=list(LENSES), default=list(LENSES), help="some lenses")
    parser.add_argument("--rays", type=int, default=256, help="per pixel on the average")
    return parser.parse_args()


def camera() -> Camera:
    return look_at((0, 0, 0), (0, 0, -1), width=WIDTH, height=HEIGHT, focal_length=0.085, sensor_width=0.036)


def heart(size: int = 48) -> np.ndarray:
    """A heart, upright, as light on black."""
    y, x = np.mgrid[1.25 : -1.35 : size * 1j, -1.25 : 1.25 : size * 1j]
    return ((x**2 + y**2 - 0.9) ** 3 - 1.3 * x**2 * y**3 < 0).astype(float)


def opened(aperture: AbstractAperture) -> AbstractLens:
    """An 85 mm lens at f/1.2 with this opening, focused on the chart."""
    return thin_lens(focus_distance=FOCUS, focal_length=0.085, f_number=1.2, aperture=aperture)


def soft(strength: float) -> AbstractLens:
    """With a rim that focuses nearer by so many dioptres."""
    return AberratedLens(opened(Disk()), (power_profile([0.0, strength]),))


def of_seidel(**coefficients: float) -> AbstractLens:
    lens = opened(Disk())
    return AberratedLens(lens, (seidel(lens, camera(), **coefficients),))


LENSES: dict[str, Callable[[], AbstractLens]] = {
    "thin": lambda: opened(Disk()),
    "blades": lambda: opened(polygon(7, rotation=0.2, roundness=0.25)),
    "mirror": lambda: opened(obstructed(0.45)),
    "anamorphic": lambda: opened(squeezed(2.0, Disk())),
    "heart": lambda: opened(mask(heart())),
    "apodized": lambda: opened(apodized([1.0, 0.75, 0.3, 0.04])),
    "ring-weighted": lambda: opened(apodized([0.35, 0.4, 0.7, 2.0])),
    "under-corrected": lambda: soft(0.16),
    "over-corrected": lambda: soft(-0.16),
    "zones": lambda: AberratedLens(
        opened(Disk()), (power_profile([0.0, 0.1, -0.05, 0.05, -0.1, 0.05, 0.0]),)
    ),
    "colour": lambda: chromatic_lens(
        opened(Disk()), focus_offset=(-0.05, 0.0, 0.05), magnification=(1.004, 1.0, 0.996), bands=7
    ),
    "cat's eyes": lambda: vignetted_lens(opened(Disk()), camera(), corner_shift=0.75),
    "coma": lambda: of_seidel(w131=7.0),
    "astigmatism": lambda: of_seidel(w222=8.0, w220=-4.0),
}


def light(
    name: str, xy: tuple[float, float], depth: float, size: tuple[float, float], radiance: np.ndarray
) -> SceneObject:
    """A rectangle of light, `size` pixels wide and high, at a place in the picture."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array(size) / 2 + xy
    return shining(name, in_world(corners, 1 / depth, camera()), radiance)


def night() -> Scene:
    """Lights behind and before the focus, and a chart in it."""
    objects = []
    for number, (x, y) in enumerate([(x, y) for y in (24, 84) for x in (30, 90, 150, 210, 270, 330)]):
        objects.append(light(f"far {number}", (x, y), FAR, (3.0, 3.0), BRIGHT * TINTS[number % 4]))
    for number, x in enumerate((45, 105, 165, 225, 285, 345)):
        objects.append(light(f"near {number}", (x, 205), NEAR, (3.0, 3.0), BRIGHT * TINTS[number % 4]))
    for number in range(30):
        size = 3.0, 24.0 if number % 5 == 0 else 14.0
        objects.append(light(f"bar {number}", (20 + 11 * number, 150), FOCUS, size, np.full(3, 0.5)))
    return make_scene(objects, background=constant_background(DARK), unlit=True)


def close_up(picture: np.ndarray, place: tuple[float, float]) -> np.ndarray:
    """What is around one light: [WINDOW, WINDOW, 3]."""
    padded = np.pad(picture, ((WINDOW, WINDOW), (WINDOW, WINDOW), (0, 0)))
    column, row = int(place[0]) + WINDOW // 2, int(place[1]) + WINDOW // 2
    return padded[row : row + WINDOW, column : column + WINDOW]


def core_to_rim(disc: np.ndarray) -> float:
    """Mean brightness of the inner half of a disc's area over that of the outer half, by its own radius."""
    y, x = np.mgrid[0.5:WINDOW, 0.5:WINDOW] - WINDOW / 2
    away, grey = np.hypot(x, y), np.maximum(disc.mean(axis=-1) - DARK.mean(), 0.0)
    order = np.argsort(away.ravel())
    total = np.cumsum(grey.ravel()[order])
    rim = away.ravel()[order][np.searchsorted(total, 0.93 * total[-1])]
    inner, outer = away < rim * np.sqrt(0.5), (away >= rim * np.sqrt(0.5)) & (away < rim)
    return float(grey[inner].mean() / grey[outer].mean())


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    rows, sheet, numbers = [], {}, {}
    for name in options.only:
        lens = LENSES[name]()
        picture = np.asarray(render(peel(night(), camera(), lens), lens, rays=options.rays))
        discs = {kind: close_up(picture, place) for kind, place in PLACES.items()}
        numbers[name] = {f"core to rim, {kind}": core_to_rim(disc) for kind, disc in discs.items()}
        light_of = {kind: float((disc - DARK).mean(axis=-1).sum()) for kind, disc in discs.items()}
        numbers[name]["light in the corner"] = light_of["corner"] / light_of["behind"]
        large = [zoom(disc, (HEIGHT / WINDOW, HEIGHT / WINDOW, 1), order=1) for disc in discs.values()]
        rows.append(np.concatenate([picture, *large], axis=1))
        sheet[name] = np.concatenate(list(discs.values()), axis=1)
        save_png(options.out / f"{name.replace(' ', '_')}.png", rows[-1])
        print(name, {key: round(value, 3) for key, value in numbers[name].items()}, flush=True)
    save_png(options.out / "gallery.png", np.concatenate(rows, axis=0))
    write_json(options.out / "gallery.json", numbers)
    save_sheet(options.out / "sheet.jpg", sheet, row=(8.4, 1.45), dpi=75, quality=88, by_columns=True)


if __name__ == "__main__":
    main()
