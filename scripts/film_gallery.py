"""Film curves side by side: one scene, metered once, on every film, two stops to either side.

Rows are films, columns exposures; beside each row is its tone curve, the signal of the display against stops
above a metered grey.

    python scripts/film_gallery.py --out docs/films.jpg
"""

import argparse
from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from _command_line import make_parser

import focusjax as fj
from focusjax.film import GREY, develop, encode_srgb, film_names, film_preset, to_bytes

ROOT = Path(__file__).parents[1]
STOPS = (-2.0, 0.0, 2.0)
RANGE = (-8.0, 7.0)


def arguments() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="a .jpg to write")
    parser.add_argument("--rays", type=int, default=64, help="per pixel on the average")
    return parser.parse_args()


def radiance(rays: int) -> jnp.ndarray:
    """A cow, a lamp that is far brighter than she is, and a wall in the dark."""
    meshes = ROOT / "configs" / "meshes"
    spot = fj.load_mesh(meshes / "spot.glb", rotate=(0, 160, 0), scale=0.08)
    lamp = fj.load_mesh(
        meshes / "still_life" / "lamp_globe.ply", translate=(0.12, 0.05, -0.5), emission=(12.0, 9.0, 6.0)
    )
    lights = [fj.directional_light((-1, -2, -1)), fj.point_light((0.1, 0.2, -0.5), (0.3, 0.22, 0.15))]
    scene = fj.make_scene(
        [spot, lamp], ambient=0.12, lights=lights, background=fj.gradient_background(0.01, 0.08, 0.4)
    )
    camera = fj.look_at((0, 0.08, 0.4), (0.02, 0.025, 0), width=240, height=160, focal_length=0.05)
    lens = fj.thin_lens(focus_distance=0.36, f_number=2.8, focal_length=0.05)
    return fj.render(fj.peel(scene, camera, lens), lens, rays=rays)


def main() -> None:
    options = arguments()
    image = radiance(options.rays)
    signal = image * (GREY / fj.meter(image, fj.Zone((70, 60, 60, 70))))
    names = film_names()
    figure, axes = plt.subplots(
        len(names), len(STOPS) + 1, figsize=(9.6, 1.66 * len(names)), width_ratios=[1.5] * len(STOPS) + [1]
    )
    greys = np.linspace(*RANGE, 301)
    ramp = jnp.broadcast_to(jnp.asarray(GREY * 2.0**greys)[None, :, None], (1, len(greys), 3))
    for row, name in zip(axes, names, strict=True):
        film = film_preset(name)
        for axis, stops in zip(row, STOPS, strict=False):
            axis.imshow(to_bytes(develop(signal * 2.0**stops, film)))
            axis.set_xticks([])
            axis.set_yticks([])
            if name == names[0]:
                axis.set_title(f"{stops:+.0f} stops" if stops else "as metered", fontsize=9)
        row[0].set_ylabel(name.replace("_", " "), fontsize=9)
        shown = np.clip(np.asarray(encode_srgb(develop(ramp, film)))[0, :, 1], 0, 1)
        row[-1].plot(greys, shown, color="#a8531f")
        row[-1].set(xlim=RANGE, ylim=(-0.03, 1.05), xticks=[-6, -3, 0, 3, 6], yticks=[0, 1])
        row[-1].tick_params(labelsize=7)
        row[-1].axvline(0, color="0.8", linewidth=0.6, zorder=0)
    axes[-1, -1].set_xlabel("stops above grey", fontsize=8)
    figure.tight_layout(pad=0.4)
    figure.savefig(options.out, dpi=80, pil_kwargs={"quality": 86})


if __name__ == "__main__":
    main()
