"""Peak memory and time of refocusing one photograph, from the command to its report.

Without a photograph of your own, one is made: 200 discs of different sizes and distances before a wall, all
with noise for texture, and their depth as a 16-bit PNG in millimetres.

    python scripts/bench_photo.py
    python scripts/bench_photo.py --size 1000x750 --rays 16
    python scripts/bench_photo.py --photo IMG_2031.heic --sharp 1530,1980
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _command_line import make_parser
from PIL import Image

DISCS = 200


def made(folder: Path, width: int, height: int) -> list[str]:
    """A photograph and its depth in `folder`, as arguments of `focusjax refocus`."""
    random = np.random.default_rng(0)
    depth = np.full((height, width), 4000, dtype=np.uint16)
    colour = np.full((height, width, 3), 0.5, dtype=np.float32)
    for distance in np.sort(random.uniform(600, 3500, DISCS))[::-1]:
        x, y = random.uniform(0, width), random.uniform(0, height)
        radius = random.uniform(0.01, 0.05) * width
        rows = slice(max(0, int(y - radius)), min(height, int(y + radius) + 1))
        columns = slice(max(0, int(x - radius)), min(width, int(x + radius) + 1))
        v, u = np.ogrid[rows, columns]
        inside = (u - x) ** 2 + (v - y) ** 2 < radius**2
        depth[rows, columns][inside] = distance
        colour[rows, columns][inside] = random.uniform(0.1, 0.9, 3)
    noise = random.normal(0, 0.05, (height, width, 1)).astype(np.float32)
    Image.fromarray(np.uint8(255 * np.clip(colour + noise, 0, 1))).save(folder / "photo.png")
    Image.fromarray(depth).save(folder / "depth.png")
    focal = ["--focal-length-35mm", "26", "--depth", str(folder / "depth.png"), "--depth-unit", "mm"]
    return [str(folder / "photo.png"), *focal, "--sharp", f"{width // 2},{height // 2}"]


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--size", default="4000x3000", help="of the photograph that is made, in pixels")
    parser.add_argument("--photo", help="a photograph that has its depth, in place of one that is made")
    parser.add_argument("--sharp", default="320,240", help="what is to be sharp in it")
    parser.add_argument("--f-number", type=float, default=1.4)
    parser.add_argument("--rays", type=int, default=64)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if options.photo:
            photo = [options.photo, "--sharp", options.sharp]
        else:
            photo = made(folder, *(int(side) for side in options.size.split("x")))
        command = [sys.executable, "-m", "focusjax.cli", "refocus", *photo]
        command += ["--f-number", str(options.f_number), "--set", f"render.rays={options.rays}"]
        start = time.perf_counter()
        done = subprocess.run([*command, "--out", str(folder / "out")], check=False)
        seconds = time.perf_counter() - start
    # Kilobytes on Linux.
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    print(f"exit status {done.returncode}; {seconds:.1f} s, {peak:.2f} GiB at most")
    if done.returncode:
        raise SystemExit(done.returncode)


if __name__ == "__main__":
    main()
