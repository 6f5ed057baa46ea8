"""What the planner promises and what comes of it: PSNR and seconds, wanted, expected and reached.

For each config and quality a picture is planned and rendered. Its error is that against a picture of very
many rays through the same layers, as an eye or a film would have it: what is brighter than white counts
relative to itself.

    python scripts/planner_study.py configs/bars.toml configs/still_life.toml --out out/plans
"""

import argparse
from pathlib import Path

import numpy as np
from _command_line import make_parser, write_json
from _timing import timed
from numpy.typing import ArrayLike

from focusjax import job
from focusjax.bench import baked, resized
from focusjax.config import build_scene, load_config
from focusjax.layers import peel
from focusjax.trace import decibels_of, estimate_quality, plan_rays, render


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("configs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="folder for the tables")
    parser.add_argument("--qualities", nargs="+", default=["30 dB", "35 dB", "40 dB"])
    parser.add_argument("--size", default="200x150")
    parser.add_argument("--reference-rays", type=int, default=1024)
    parser.add_argument("--lights", action="store_true", help="leave lights as bright as they are")
    return parser.parse_args()


def decibels(picture: ArrayLike, truth: np.ndarray) -> float:
    """PSNR, with what is brighter than 1 relative to itself, as in `estimate_quality`."""
    error = (np.asarray(picture) - truth) / np.maximum(truth, 1.0)
    return -10.0 * float(np.log10(np.mean(error**2)))


def study(path: Path, options: argparse.Namespace) -> list[dict]:
    """A row for each quality."""
    config = load_config(path)
    outcome = job.run(config, rendering=False)
    camera = resized(outcome.camera, *(int(edge) for edge in options.size.split("x")))
    lens = outcome.lens
    scene = build_scene(config)
    layers = peel(scene if options.lights else baked(scene), camera, lens, max_layers=16)
    truth = np.asarray(render(layers, lens, rays=options.reference_rays, smooth=False, seed=99))
    rows = []
    for quality in options.qualities:
        plan = plan_rays(layers, lens, quality)
        made = timed(lambda rays=plan.rays: render(layers, lens, rays=rays), 1)
        picture = np.asarray(made.result)
        rows.append(
            {
                "scene": path.stem,
                "wanted dB": decibels_of(quality),
                "rays": plan.rays,
                "expected dB": plan.decibels,
                "reached dB": decibels(picture, truth),
                "estimated dB": estimate_quality(layers, lens, picture, rays=plan.rays).decibels,
                "expected s": plan.seconds,
                "took s": made.median,
            }
        )
        print(rows[-1], flush=True)
    return rows


def markdown(rows: list[dict]) -> str:
    lines = ["| " + " | ".join(rows[0]) + " |", "|" + " --- |" * len(rows[0])]
    for row in rows:
        values = (f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values())
        lines.append("| " + " | ".join(values) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = [row for path in options.configs for row in study(path, options)]
    print(markdown(rows))
    (options.out / "plans.md").write_text(markdown(rows))
    write_json(options.out / "plans.json", rows)


if __name__ == "__main__":
    main()
