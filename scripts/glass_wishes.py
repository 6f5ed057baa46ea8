"""Wishes met through glass, against pictures of points: is the blur that a solve reports that of the picture?

Problems at random over the lenses that come along: two or three wishes, sharp, blurred on either side, or at
most so blurred, focus or focus and f-number free. Each is solved through the glass; then a small bright
square at every wish's place is seen through the lens found by places all over the film, and sqrt(8 M), with M
the mean square distance of its light from the middle, less what the square itself has of it, is compared
with the blur reported. Derivatives of the focus by the depths wished at are compared with differences.

    python scripts/glass_wishes.py --problems 50 --json result.json
"""

import argparse
import dataclasses
import functools
import statistics
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, write_json
from _timing import timed
from rich.console import Console
from rich.progress import track
from scipy.stats import qmc

import focusjax as fj
from focusjax.focus import ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

LENSES = (
    ("gauss_jp62087922_f1.8_1987", 0.05, 2.0),
    ("planar_us583336_f4.5_1897", 0.05, 4.5),
    ("cooke_triplet_50mm_f4", 0.05, 4.0),
    ("retrofocus_35mm_f2", 0.035, 2.8),
)
"""Presets, focal length in metres, and f-number to start with."""
WIDTH, HEIGHT = 240, 160
NEAR, FAR = 0.7, 4.0
SIDE_PX = 1.0
PLACES = 49
"""Of the film that are looked at around a wish's place, on either axis."""
STEP = 1e-4


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--problems", type=int, default=50)
    parser.add_argument("--rays", type=int, default=1024, help="through the stop from each place of the film")
    parser.add_argument("--gradients", type=int, default=8, help="problems of which derivatives are compared")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def wishes(rng: np.random.Generator, camera: Camera) -> ImagePoints:
    """Two or three wishes at random places, of which spots stay in the frame."""
    found = []
    for _ in range(rng.integers(2, 4)):
        depth = 1.0 / rng.uniform(1.0 / FAR, 1.0 / NEAR)
        x, y = rng.uniform(-0.35, 0.35, 2) * (WIDTH, HEIGHT) * depth / float(camera.focal_px)
        size = rng.uniform(1.0, 9.0)
        kinds = [fj.Sharp(), fj.Blur(size), fj.Blur(size, signed=True), fj.AtMost(size)]
        found.append(fj.FocusPoint(fj.AtPoint((x, y, -depth)), kinds[rng.integers(len(kinds))]))
    return fj.locate(found, camera)


@eqx.filter_jit
def light(
    camera: Camera, lens: AbstractLens, xy: jax.Array, disparity: jax.Array, off: jax.Array, rays: int
) -> jax.Array:
    """Light of a small square at places of the film, each of which looks through all of the stop."""
    square = jnp.asarray(qmc.Sobol(2, rng=np.random.default_rng(1)).random(rays))
    pupil = jax.vmap(lens.pupil_point)(square)

    def one(place: jax.Array) -> jax.Array:
        ray = jax.vmap(lambda v: lens.ray(camera, place, v))(pupil)
        inside = jnp.all(jnp.abs(ray.a + ray.b * disparity - xy) < SIDE_PX / 2, axis=1)
        return jnp.mean(ray.weight * inside)

    return jax.lax.map(one, xy + off, batch_size=64)


def measured(
    camera: Camera, lens: AbstractLens, xy: jax.Array, disparity: jax.Array, rays: int, about: float
) -> float:
    """The blur, without its sign, of a small square on the film; nothing is followed from the point.

    Places are as dense as a blur of `about` pixels needs.
    """
    reach = SIDE_PX + 1.2 * about + 0.5
    steps = np.linspace(-reach, reach, PLACES)
    off = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    share = np.asarray(light(camera, lens, xy, disparity, jnp.asarray(off), rays))
    share = share / share.sum()
    square = share @ ((off - share @ off) ** 2).sum(axis=1) - SIDE_PX**2 / 6.0
    return float(np.sqrt(8.0 * max(square, 0.0)))


def slopes(points: ImagePoints, camera: Camera, start: fj.ThinLens, glass: AbstractLens, free) -> list:
    """Change of the focus with the depth wished at first: by derivatives, and by differences of solves."""

    def focus(disparity):
        moved = dataclasses.replace(points, disparity=points.disparity.at[0].set(disparity))
        return fj.solve(moved, camera, start, through=glass, free=free, throw=False).lens.focus_disparity

    at = points.disparity[0]
    exact = float(jax.jvp(focus, (at,), (jnp.ones_like(at),))[1])
    return [exact, float((focus(at + STEP) - focus(at - STEP)) / (2 * STEP))]


def main() -> None:
    options = arguments()
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(0)
    console, rows, gradients, seconds = Console(), [], [], []
    setups = {}
    for name, length, number in LENSES:
        camera = fj.look_at((0, 0, 0), (0, 0, -1), width=WIDTH, height=HEIGHT, focal_length=length)
        start = fj.thin_lens(focus_distance=2.0, f_number=number, focal_length=length)
        glass = fj.prescription_lens(fj.lens_preset(name), camera, focus_distance=2.0)
        setups[name] = camera, start, glass
    for number in track(range(options.problems), console=console):
        earlier, name = name, LENSES[number * len(LENSES) // options.problems][0]
        if name != earlier:
            # Each lens has programs of its own, and those of all would be too many for one process.
            jax.clear_caches()
        camera, start, glass = setups[name]
        points = wishes(rng, camera)
        free = ("focus", "f_number") if rng.random() < 0.5 else ("focus",)
        solved = timed(functools.partial(fj.solve, points, camera, start, through=glass, free=free), 1)
        solution = solved.result
        seconds.append(solved.median)
        assert isinstance(solution.glass, AbstractLens)
        for index, row in enumerate(solution.table()):
            place = points.xy[index], points.disparity[index]
            seen = measured(camera, solution.glass, *place, options.rays, abs(row.got))
            rows.append({"lens": name, "wish": row.name, "reported": row.got, "measured": seen})
        if len(gradients) * options.problems < options.gradients * (number + 1):
            gradients.append(slopes(points, camera, start, glass, free))
    off = [abs(abs(row["reported"]) - row["measured"]) for row in rows]
    console.print(
        f"{options.problems} problems, {len(rows)} wishes: reported and measured differ by"
        f" {max(off):.3f} px at most, {statistics.median(off):.3f} px in the middle"
    )
    console.print(f"a solve takes {statistics.median(seconds):.2f} s, {max(seconds):.2f} s at most")
    if gradients:
        apart = max(abs(a - b) / max(abs(b), 1e-3) for a, b in gradients)
        console.print(f"derivatives and differences differ by {100 * apart:.3g} % at most")
    write_json(options.json, {"rows": rows, "gradients": gradients, "seconds": seconds})


if __name__ == "__main__":
    main()
