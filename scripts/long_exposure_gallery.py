"""Lights that turn like stars, exposed for longer and longer: 1, 6 and 24 frames that adjoin.

What stands still is as bright in all of them; the trails grow, none brighter than another.

    python scripts/long_exposure_gallery.py --out docs/long_exposure.jpg
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import imageio.v3 as iio
import jax.numpy as jnp
import numpy as np
from _command_line import make_parser
from _sheets import beside

import focusjax as fj
from focusjax.config import load_config
from focusjax.film import to_bytes
from focusjax.io import load_exr
from focusjax.shot import film

CONFIG = Path(__file__).parents[1] / "configs" / "passing_by.toml"
FRAMES = (1, 6, 24)
OVERRIDES = [
    "shot.camera=[]",
    "camera.position=[0, 0.17, 0.78]",
    "camera.look_at=[0, 0.15, 0]",
    "lens.f_number=2.8",
    'shot.formats=["exr"]',
    f"shot.frames={FRAMES[-1]}",
    "shutter={angle_deg=360}",
    'shot.objects=[{name="warm bulbs", keys=[{frame=1, translate=[0, 0.79, -2.35], rotate_deg=[0, 0, 0]},'
    f" {{frame={FRAMES[-1]}, translate=[0, 0.79, -2.35], rotate_deg=[0, 0, 50]}}]}}]",
]


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="a .jpg to write")
    parser.add_argument("--size", nargs=2, type=int, default=[300, 240], help="of each picture, in pixels")
    parser.add_argument("--rays", type=int, default=256, help="per pixel and frame")
    return parser.parse_args()


def frames(options: argparse.Namespace) -> Iterator[np.ndarray]:
    """Linear radiance of each frame, by rays of its own, for their noise to even out."""
    width, height = options.size
    size = [f"camera.resolution=[{width}, {height}]", f"render.rays={options.rays}"]
    for number in range(1, FRAMES[-1] + 1):
        with tempfile.TemporaryDirectory() as folder:
            film(
                load_config(CONFIG, [*OVERRIDES, *size, f"render.seed={number}"]),
                Path(folder),
                frames=[number],
            )
            image = load_exr(Path(folder) / "frames" / f"frame_{number:04d}.exr")
        yield np.stack([image[colour] for colour in "RGB"], axis=-1)


def main() -> None:
    options = arguments()
    exposure, pictures = fj.start_exposure(*options.size), []
    for number, frame in enumerate(frames(options), start=1):
        exposure = exposure.add(jnp.asarray(frame, dtype=float))
        if number in FRAMES:
            pictures.append(to_bytes(fj.develop(exposure.picture, fj.film_preset("filmic"))))
    iio.imwrite(options.out, beside(*pictures), quality=90)


if __name__ == "__main__":
    main()
