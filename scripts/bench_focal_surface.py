"""How long a focal surface takes: 50 control points all over a picture of 1920 x 1080, warm.

Run it on a quiet machine; it prints medians, and by how much blur between pixel corners is off, in pixels.
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np
from _timing import timed

from focusjax.geometry import make_camera
from focusjax.lens import focal_surface, focal_surface_lens, thin_lens


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=50)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    camera = make_camera(jnp.eye(4), width=width, height=height, focal_length=0.05)
    thin = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
    rng = np.random.default_rng(0)
    xy = rng.uniform((0, 0), (width, height), (options.points, 2))
    values = rng.uniform(0.3, 1, options.points)
    films = jnp.asarray(rng.uniform((0, 0), (width, height), (20000, 2)), dtype=float)
    print(f"{'basis':>10} {'first s':>8} {'warm s':>8} {'error px':>9}")
    for basis in ("constant", "affine", "quadratic"):
        surface = focal_surface(xy, values, basis=basis)
        made = timed(lambda surface=surface: focal_surface_lens(surface, camera, thin), options.repeats)
        lens = made.result
        sampled = jax.vmap(lambda p, lens=lens: lens.thin_lens_at(camera, p).focus_disparity)(films)
        miss = 2 * thin.parallax(camera) * jnp.abs(surface.at(films.T)[0] - sampled).max()
        print(f"{basis:>10} {made.first:8.2f} {made.median:8.3f} {float(miss):9.2g}")


if __name__ == "__main__":
    main()
