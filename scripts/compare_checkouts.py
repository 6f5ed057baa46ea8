"""What a thin still picture costs in two checkouts of the project, in turn: solve, peel and 64 rays.

    git worktree add ../before REVISION
    python scripts/compare_checkouts.py ../before .

Seconds are of process time, warm, the best of several in each turn. Configs are those of the second checkout.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import jax
from _command_line import make_parser
from _timing import timed
from rich.console import Console
from rich.table import Table

import focusjax as fj
from focusjax.config import build_scene, load_config
from focusjax.job import run

STAGES = ("solve", "peel", "render")


def best(work: Callable[[], object], repeats: int) -> float:
    """Least process time of `work`, after a first that compiles."""
    return min(timed(work, repeats).cpu[1:])


def measured(path: Path, rays: int) -> dict[str, float]:
    """Seconds of each stage, by the focusjax that this process imports."""
    config = load_config(path)
    outcome = run(config, solving=True, rendering=False)
    scene, camera, lens, points = build_scene(config), outcome.camera, outcome.lens, outcome.points
    layers = fj.peel(scene, camera, lens)
    return {
        "solve": best(lambda: fj.solve(points, camera, lens).blur, 200),
        "peel": best(lambda: jax.tree.leaves(fj.peel(scene, camera, lens)), 6),
        "render": best(lambda: fj.render(layers, lens, rays=rays), 4),
    }


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("checkouts", nargs=2, type=Path, help="before, and now")
    parser.add_argument("--configs", nargs="+", default=["still_life", "town"])
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    before, now = (folder.resolve() for folder in options.checkouts)
    paths = {name: now / "configs" / f"{name}.toml" for name in options.configs}
    if options.measure:
        print(json.dumps({name: measured(path, options.rays) for name, path in paths.items()}))
        return
    table = Table("config", "stage", "turn", "before, s", "now, s", "ratio")
    for turn in range(1, options.turns + 1):
        found = []
        for folder in (before, now):
            command = [sys.executable, *sys.argv, "--measure"]
            environment = {**os.environ, "PYTHONPATH": str(folder)}
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            found.append(json.loads(done.stdout.splitlines()[-1]))
        for name in options.configs:
            for stage in STAGES:
                old, new = (each[name][stage] for each in found)
                table.add_row(name, stage, str(turn), f"{old:.4f}", f"{new:.4f}", f"{new / old:.2f}")
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
