"""How long a focus solve takes: compile, and warm including everything Python does.

The same wishes are solved by the solver of focusjax, by L-BFGS-B of jaxopt and, as a yardstick, by scipy
on the same residuals from one start, with their Jacobian written out. With `--many` that many random problems
of eight wishes are solved in one call of `solve_many`, and by a loop over scipy. Run it on a quiet
machine; it prints medians.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from _timing import timed

from focusjax.focus import (
    AtLeast,
    AtMost,
    AtPoint,
    Blur,
    FocusPoint,
    ImagePoints,
    Sharp,
    locate,
    solve,
    solve_many,
)
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens
from focusjax.solvers import JaxoptLBFGSB

FREE = ("focus", "f_number")
SCIPY_METHODS = ("trf", "dogbox")
SOLVERS = {"bounded LM": None, "jaxopt": JaxoptLBFGSB()}


def wishes(count, camera):
    """Sharp and blurred points between 1 m and 9 m, straight ahead."""
    wish = [Sharp(), Blur(12.0), Blur(-4.0, signed=True), Sharp()]
    points = [FocusPoint(AtPoint((0, 0, -(1 + 8 * i / count))), wish[i % 4]) for i in range(count)]
    return locate(points, camera)


def scipy_solver(points, camera, start, method):
    """Bounded least squares by scipy over focus disparity and aperture radius, from the starting lens.

    `method` is "trf", scipy's default, or "dogbox", which is the quicker one here.
    """
    slope = 2 * float(camera.focal_px)
    disparity, target, signed, root = (
        np.asarray(value) for value in (points.disparity, points.target, points.signed, points.weight**0.5)
    )
    length = float(camera.focal_length)
    box = (np.array([0.0, length / 64]), np.array([1 / (2 * length), length / 2]))
    first = np.array([float(start.focus_disparity), float(start.aperture_radius)])

    def residuals(value):
        blur = slope * value[1] * (value[0] - disparity)
        return root * (np.where(signed, blur, abs(blur)) - target)

    def jacobian(value):
        off = value[0] - disparity
        sign = np.where(signed | (off >= 0), 1.0, -1.0)
        return (slope * root * sign)[:, None] * np.stack([np.full_like(off, value[1]), off], axis=1)

    return lambda: (
        scipy.optimize.least_squares(
            residuals,
            first,
            jac=jacobian,  # pyright: ignore[reportArgumentType]  # scipy takes functions, too
            bounds=box,
            x_scale=(1.0, 1e-2),
            method=method,
        ).cost
    )


def report(count, free, method, run, repeats):
    """Prints one line of the table."""
    found = timed(run, repeats)
    name = " + ".join(free)
    seconds = f"{found.first:8.2f} {1e3 * found.median:8.2f} {1e3 * min(found.wall[1:]):8.2f}"
    print(f"{count:6} {name:>30} {method:>12} {seconds} {float(found.result):11.4g}")


def random_problems(count, wishes=8):
    """Sets of sharp, signed and unsigned wishes with a leading axis."""
    rng = np.random.default_rng(0)
    shape = (count, wishes)
    sharp, signed = rng.random(shape) < 0.3, rng.random(shape) < 0.5
    target = np.where(sharp, 0.0, np.where(signed, rng.normal(0, 20, shape), rng.exponential(20, shape)))
    return ImagePoints(
        xy=jnp.full((*shape, 2), 300.0),
        disparity=jnp.asarray(rng.uniform(0, 2, shape), dtype=float),
        target=jnp.asarray(target, dtype=float),
        signed=jnp.asarray(signed | sharp),
        weight=jnp.asarray(10.0 ** rng.uniform(-2, 2, shape), dtype=float),
        tolerance=jnp.ones(shape),
        wish=jnp.tile(jnp.arange(wishes), (count, 1)),
        names=(),
    )


def report_many(count, camera, lens):
    """One call for all problems against scipy, one after the other from one start each."""
    problems = random_problems(count)
    found = timed(lambda: solve_many(problems, camera, lens, free=FREE, throw=False).cost, 3)
    sample = min(count, 300)
    each = [jax.tree.map(lambda leaf, i=i: leaf[i], problems) for i in range(sample)]
    print(f"{count} problems of 8 wishes: {found.median:.2f} s in one call (first {found.first:.2f} s)")
    ours = np.asarray(found.result)[:sample]
    for method in SCIPY_METHODS:
        solvers = [scipy_solver(points, camera, lens, method) for points in each]
        start = time.perf_counter()
        costs = np.array([solver() for solver in solvers])
        looped = (time.perf_counter() - start) / sample * count
        worse = [np.mean(a > b * (1 + 1e-3) + 1e-6) for a, b in ((costs, ours), (ours, costs))]
        print(f"a loop over scipy's {method}: {looped:.1f} s ({sample} timed), {looped / found.median:.0f} x")
        print(f"its answer is worse in {worse[0]:.0%}, ours in {worse[1]:.0%}")


def report_general(camera, lens, repeats):
    """Ten wishes of all kinds over focus, f-number, tilt and swing."""
    kinds = [Sharp(), AtMost(3.0), AtLeast(6.0), Blur(-4.0, signed=True), Sharp()]
    places = [AtPoint((0.1 * (i % 3 - 1) * i, 0.05 * (i % 4) * i, -(1 + i))) for i in range(10)]
    wished = [FocusPoint(place, kinds[i % 5]) for i, place in enumerate(places)]
    points = locate(wished, camera)
    free = (*FREE, "tilt", "swing")
    report(10, free, "bounded LM", lambda: solve(points, camera, lens, free=free, throw=False).cost, repeats)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=50, help="warm solves to take the median of")
    parser.add_argument("--many", type=int, default=10_000, help="problems to solve in one call")
    arguments = parser.parse_args()
    repeats = arguments.repeats
    camera = make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)
    lens = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
    columns = ("first s", "warm ms", "best ms")
    print(
        f"{'wishes':>6} {'free':>30} {'solver':>12}",
        *(f"{name:>8}" for name in columns),
        f"{'cost px^2':>11}",
    )
    for count in (1, 10):
        points = wishes(count, camera)
        for free in (FREE[:1], FREE):
            for name, solver in SOLVERS.items():

                def run(points=points, free=free, solver=solver):
                    return solve(points, camera, lens, free=free, solver=solver, throw=False).cost

                report(count, free, name, run, repeats)
        for method in SCIPY_METHODS:
            report(count, FREE, f"scipy {method}", scipy_solver(points, camera, lens, method), repeats)
    report_general(camera, lens, repeats)
    report_many(arguments.many, camera, lens)


if __name__ == "__main__":
    main()
