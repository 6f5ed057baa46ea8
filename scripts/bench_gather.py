"""What coverage-weighted mip maps do for gathering: error and time with and without them, in one run.

Of special cases with strong blur and of configs as they are, against a ray cast. Processor seconds, median of
alternating turns after a first one.

    python scripts/bench_gather.py
"""

import functools
from pathlib import Path
from unittest import mock

import numpy as np
from _command_line import make_parser, make_table
from _special_scenes import CASES
from _timing import timed_in_turns
from rich.console import Console

from focusjax.baselines import RayScene, lens_picture, pinhole_view
from focusjax.bench import case_from_config
from focusjax.config import load_config
from focusjax.metrics import psnr
from focusjax.post import _gather, gather

LEVELS = (0, _gather._MOST_LEVELS)
"""Of mip maps: none, and as many as there are."""


def gathered(view: tuple[np.ndarray, np.ndarray], case, taps: int, levels: int) -> np.ndarray:
    """The picture by at most so many levels."""
    with mock.patch.object(_gather, "_MOST_LEVELS", levels):
        return np.asarray(gather(*view, case.camera, case.lens, taps=taps))


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument(
        "--cases", nargs="*", choices=list(CASES), default=["foreground blur", "highlights", "wide blur"]
    )
    parser.add_argument("--configs", nargs="*", type=Path, default=[Path("configs/still_life.toml")])
    parser.add_argument("--size", default="400x300", help="of the configs, in pixels")
    parser.add_argument("--taps", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--truth-rays", type=int, default=512, help="per pixel")
    parser.add_argument("--turns", type=int, default=3)
    options = parser.parse_args()
    width, height = (int(side) for side in options.size.split("x"))
    cases = {name: CASES[name]() for name in options.cases}
    cases |= {path.stem: case_from_config(load_config(path), (width, height)) for path in options.configs}
    headings = ("case", "taps", "dB without", "dB with", "s without", "s with")
    table = make_table("gathering without and with mip maps", *headings)
    for name, case in cases.items():
        scene = RayScene(case.scene)
        truth = np.clip(lens_picture(scene, case.camera, case.lens, rays=options.truth_rays), 0.0, 1.0)
        view = pinhole_view(scene, case.camera)
        for taps in options.taps:
            runs = {levels: functools.partial(gathered, view, case, taps, levels) for levels in LEVELS}
            found = timed_in_turns(runs, options.turns).values()
            table.add_row(
                name,
                str(taps),
                *(f"{psnr(np.clip(each.result, 0.0, 1.0), truth):.1f}" for each in found),
                *(f"{each.cpu_median:.2f}" for each in found),
            )
    Console().print(table)


if __name__ == "__main__":
    main()
