"""How long a shot's joint solve takes, warm, and how steady it is.

Run it on a quiet machine. Without a config it solves frames of ten wishes each, of which half hand over to
the other half; with one, the config's own shot, finding the wishes in all frames included.
"""

import argparse
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from _timing import timed

from focusjax.config import load_config
from focusjax.focus import AtPoint, Blur, FocusPoint, Sharp, locate, solve, solve_frames
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens
from focusjax.shot import build_shot, faded, solve_shot


def random_rack_focus(frames: int, wishes: int):
    """Points of every frame, camera and lens: the first half of the wishes acts early, the other late."""
    camera = make_camera(jnp.eye(4), width=1920, height=1080, focal_length=0.05)
    lens = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
    rng = np.random.default_rng(0)
    early = np.arange(wishes) < wishes // 2
    distance = np.where(early, rng.uniform(1.0, 1.2, wishes), rng.uniform(3.0, 4.0, wishes))
    frame = np.arange(frames)[:, None]
    acts = np.where(early, frame < 0.4 * frames, frame >= 0.6 * frames).astype(float)
    share = faded(acts, 6.0)
    points = []
    for t in range(frames):
        depth = distance * (1 + 0.05 * np.sin(0.2 * t))
        asked = [
            FocusPoint(
                AtPoint((0.02 * number - 0.1, 0.1 * (number % 3 - 1), -depth[number])),
                Sharp() if number % 2 else Blur(4.0),
                weight=share[t, number],
                name=f"wish {number}",
            )
            for number in range(wishes)
        ]
        points.append(locate(asked, camera, may_be_idle=True))
    return points, camera, lens


def report(name, free, run, repeats):
    found = timed(run, repeats)
    solution = found.result
    print(
        f"{name}, free {', '.join(free)}: {solution.count} frames, first {found.first:.2f} s, warm"
        f" {found.median:.4f} s (median of {repeats}), {int(solution.steps)} steps"
    )
    for setting, change in solution.largest_changes().items():
        said = f"at most {change.per_frame:.4g} per frame, {change.per_frame2:.4g} per frame^2"
        if change.pixels_per_frame is not None:
            said += f"; {change.pixels_per_frame:.3g} px per frame"
            said += f", {change.pixels_per_frame2:.3g} px per frame^2"
        print(f"  {setting}: {said}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", nargs="?", type=Path)
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--wishes", type=int, default=10)
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    if options.config is not None:
        shot = build_shot(load_config(options.config))
        report(options.config.stem, shot.options["free"], lambda: solve_shot(shot).solution, 1)
        return
    points, camera, lens = random_rack_focus(options.frames, options.wishes)
    for free in (("focus",), ("focus", "f_number"), ("focus", "tilt")):
        report(
            "random rack focus", free,
            lambda free=free: solve_frames(points, camera, lens, free=free), options.repeats,
        )  # fmt: skip
        start = time.perf_counter()
        shorter = solve_frames(points[:-3], camera, lens, free=free)
        jax.block_until_ready(shorter.cost)
        print(f"  the first time of {shorter.count} frames: {time.perf_counter() - start:.2f} s")
    # What is avoided: the frames one by one.
    counted = [each for each in points if float(jnp.sum(each.weight)) > 0]
    alone = [float(solve(each, camera, lens).lens.focus_disparity) for each in counted]
    print(f"frame by frame: focus_per_m changes by up to {np.abs(np.diff(alone)).max():.4g} per frame")


if __name__ == "__main__":
    main()
