"""How long a focal surface takes, over a picture of 1920 x 1080: first calls, which compile, and warm ones.

First a lens is made of control points. Then some are solved for as many wishes, in one picture and in a shot
of 48 frames; after it one of 45, which uses the same program. Run it on a quiet machine; it prints medians,
and by how much blur between pixel corners is off, in pixels.
"""

import argparse
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from _timing import timed

from focusjax.focus import (
    AtPixel,
    Blur,
    FocusPoint,
    Sharp,
    SurfaceFramesSolution,
    locate,
    solve_focal_surface,
    solve_surface_frames,
)
from focusjax.geometry import Camera, make_camera
from focusjax.lens import ThinLens, focal_surface, focal_surface_lens, thin_lens


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=50)
    parser.add_argument("--wishes", type=int, default=8)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    camera = make_camera(jnp.eye(4), width=width, height=height, focal_length=0.05)
    thin = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
    _make(options.points, camera, thin, options.repeats)
    _solve(options.wishes, camera, thin, options.repeats)


def _make(count: int, camera: Camera, thin: ThinLens, repeats: int) -> None:
    """A lens of control points, by basis."""
    rng = np.random.default_rng(0)
    size = camera.width, camera.height
    xy = rng.uniform((0, 0), size, (count, 2))
    values = rng.uniform(0.3, 1, count)
    films = jnp.asarray(rng.uniform((0, 0), size, (20000, 2)), dtype=float)
    print(f"{'basis':>10} {'first s':>8} {'warm s':>8} {'error px':>9}")
    for basis in ("constant", "affine", "quadratic"):
        surface = focal_surface(xy, values, basis=basis)
        made = timed(lambda surface=surface: focal_surface_lens(surface, camera, thin), repeats)
        lens = made.result
        sampled = jax.vmap(lambda p, lens=lens: lens.thin_lens_at(camera, p).focus_disparity)(films)
        miss = 2 * thin.parallax(camera) * jnp.abs(surface.at(films.T)[0] - sampled).max()
        print(f"{basis:>10} {made.first:8.2f} {made.median:8.3f} {float(miss):9.2g}")


def _solve(count: int, camera: Camera, thin: ThinLens, repeats: int) -> None:
    """Control points where wishes are, every second of them sharp, in a picture and in shots."""
    rng = np.random.default_rng(1)
    xy = rng.uniform((0, 0), (camera.width, camera.height), (count, 2))
    nearness = rng.uniform(0.3, 1, count)
    surface = focal_surface(xy, 0.5)
    wishes = [
        FocusPoint(AtPixel(*place), Blur(4.0) if number % 2 else Sharp()) for number, place in enumerate(xy)
    ]

    there = locate(wishes, camera, disparity_map=jnp.ones((camera.height, camera.width)))
    # Everything comes nearer, and goes again.
    frames = [
        dataclasses.replace(there, disparity=jnp.asarray((1 + 0.3 * np.sin(0.2 * frame)) * nearness))
        for frame in range(48)
    ]

    def shot(length: int) -> SurfaceFramesSolution:
        cameras, surfaces, lenses = [camera] * length, [surface] * length, [thin] * length
        return solve_surface_frames(frames[:length], cameras, surfaces, lenses)

    print(f"{'solved':>10} {'first s':>8} {'warm s':>8}")
    for name, run in {
        "one": lambda: solve_focal_surface(frames[0], camera, surface, thin),
        "48 frames": lambda: shot(48),
        "45 frames": lambda: shot(45),
    }.items():
        made = timed(run, repeats)
        print(f"{name:>10} {made.first:8.2f} {made.median:8.3f}")


if __name__ == "__main__":
    main()
