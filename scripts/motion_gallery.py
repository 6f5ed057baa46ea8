"""One moment by four shutters: quick, slow, slow while the camera follows, and one that runs down.

python scripts/motion_gallery.py --out docs/motion.jpg
"""

import argparse
import tempfile
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from _command_line import make_parser
from _sheets import beside

from focusjax.config import load_config
from focusjax.shot import film

CONFIG = Path(__file__).parents[1] / "configs" / "passing_by.toml"
FRAME = 6
STANDS = ["shot.camera=[]", "camera.position=[0, 0.17, 0.78]", "camera.look_at=[0, 0.085, 0]"]
SHUTTERS = [
    [*STANDS, "shutter.time=1/2000"],
    [*STANDS, "shutter.time=1/15"],
    ["shutter.time=1/15"],
    [*STANDS, "shutter.time=1/2000", "shutter.travel_time=1/6"],
]


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="a .jpg to write")
    parser.add_argument("--size", nargs=2, type=int, default=[360, 240], help="of each picture, in pixels")
    parser.add_argument("--rays", type=int, default=64, help="per pixel")
    return parser.parse_args()


def picture(overrides: list[str], options: argparse.Namespace) -> np.ndarray:
    width, height = options.size
    common = [f"camera.resolution=[{width}, {height}]", f"render.rays={options.rays}"]
    with tempfile.TemporaryDirectory() as folder:
        film(load_config(CONFIG, [*common, *overrides]), Path(folder), frames=[FRAME])
        return iio.imread(Path(folder) / "frames" / f"frame_{FRAME:04d}.png")


def main() -> None:
    options = arguments()
    first, second, third, fourth = (picture(overrides, options) for overrides in SHUTTERS)
    sheet = beside(beside(first, second), beside(third, fourth), axis=0)
    iio.imwrite(options.out, sheet, quality=90)


if __name__ == "__main__":
    main()
