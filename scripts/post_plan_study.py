"""What is estimated of post-processing before it is chosen, what comes of it, and what choosing it spares.

For each config and size a picture is post-processed, its error estimated as `plan_post` does, and compared
with the error against a picture of many rays through the same layers. Beside it, for each quality, stands
what `plan_rays` plans. `choosing` is the time to plan and make a picture: of post-processing where it is
estimated to reach the quality, else that in vain, and then that of planned rays; `tracing` plans rays at
once. Seconds are of process time (all cores), the least of some turns, programs being compiled; what is
estimated of 4 rays over post-processing is the median of ratios of wall-clock times.

    python scripts/post_plan_study.py configs/town.toml configs/bars.toml --out out/post_plans
    python scripts/post_plan_study.py configs/still_life.toml --baked --out out/post_plans_baked
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _command_line import make_parser, write_json
from _timing import timed_in_turns
from planner_study import decibels, markdown

from focusjax import job
from focusjax.bench import baked, resized
from focusjax.config import build_look, build_scene, load_config
from focusjax.layers import peel
from focusjax.post import plan_post, post_process, view_in_layers
from focusjax.trace import decibels_of, plan_rays, render


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("configs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="folder for the tables")
    parser.add_argument("--qualities", nargs="+", default=["20 dB", "25 dB", "30 dB", "35 dB"])
    parser.add_argument("--sizes", nargs="+", default=["320x240"])
    parser.add_argument("--seeds", type=int, default=8, help="of which each measures the error anew")
    parser.add_argument("--reference-rays", type=int, default=512)
    parser.add_argument("--baked", action="store_true", help="without lights brighter than white, or gloss")
    parser.add_argument("--turns", type=int, default=3)
    return parser.parse_args()


def least_seconds(runs: dict[str, Callable[[], Any]], turns: int) -> dict[str, float]:
    """Of each, called in turns, after once for programs to be compiled."""
    return {name: min(found.cpu[1:]) for name, found in timed_in_turns(runs, turns).items()}


def study(path: Path, size: str, options: argparse.Namespace) -> tuple[dict, list[dict]]:
    """What is estimated of post-processing, and a row for each quality."""
    config = load_config(path)
    outcome = job.run(config, rendering=False)
    camera = resized(outcome.camera, *(int(edge) for edge in size.split("x")))
    lens = build_look(config, camera, outcome.lens)
    scene = baked(build_scene(config)) if options.baked else build_scene(config)
    layers = peel(scene, camera, lens, supersampling=1, max_layers=config.render.max_layers)
    truth = np.asarray(render(layers, lens, rays=options.reference_rays, smooth=False, seed=99))
    view = view_in_layers(layers, scene)
    plans = [plan_post(view, layers, lens, 30, seed=10 * seed) for seed in range(options.seeds)]
    taps = plans[0].taps
    real = decibels(np.asarray(post_process(view, camera, lens, taps=taps)), truth)
    took = least_seconds(
        {
            "post": lambda: np.asarray(post_process(view, camera, lens, taps=taps)),
            "4 rays": lambda: np.asarray(render(layers, lens, rays=4)),
            "estimating": lambda: plan_post(view, layers, lens, 30),
        },
        options.turns,
    )
    estimating, blurring = took["estimating"], took["post"]
    head = {"scene": path.stem, "size": size}
    ratios = [plan.fewest_seconds / plan.seconds for plan in plans]
    estimate = head | {
        "real dB": real,
        "estimated dB, least": min(plan.decibels for plan in plans),
        "most": max(plan.decibels for plan in plans),
        "sure dB, least": min(plan.at_least for plan in plans),
        "sure, most": max(plan.at_least for plan in plans),
        "post s": blurring,
        "4 rays s": took["4 rays"],
        "4 rays over post, estimated": float(np.median(ratios)),
        "estimating s": estimating,
    }
    print(estimate, flush=True)
    rows = []
    for quality in options.qualities:
        wanted, plan = decibels_of(quality), plan_rays(layers, lens, quality)
        picture = np.asarray(render(layers, lens, rays=plan.rays))
        took = least_seconds(
            {
                "planning": lambda quality=quality: plan_rays(layers, lens, quality),
                "tracing": lambda rays=plan.rays: np.asarray(render(layers, lens, rays=rays)),
            },
            options.turns,
        )
        post = plans[0].at_least >= wanted
        traced = took["planning"] + took["tracing"]
        choosing = estimating + (blurring if post else traced)
        rows.append(
            head
            | {
                "wanted dB": wanted,
                "chosen": "post" if post else f"{plan.rays} rays",
                "real dB": real if post else decibels(picture, truth),
                "rays planned": plan.rays,
                "rays' real dB": decibels(picture, truth),
                "choosing s": choosing,
                "tracing s": traced,
            }
        )
        print(rows[-1], flush=True)
    return estimate, rows


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    found = [study(path, size, options) for path in options.configs for size in options.sizes]
    estimate, rows = [one for one, _ in found], [row for _, some in found for row in some]
    tables = f"{markdown(estimate)}\n{markdown(rows)}"
    print(tables)
    (options.out / "post_plans.md").write_text(tables)
    saved = {"estimated": estimate, "chosen": rows}
    write_json(options.out / "post_plans.json", saved)


if __name__ == "__main__":
    main()
