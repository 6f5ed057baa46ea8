"""Derivatives of pictures by focus, aperture and tilt, against differences of converged pictures.

The truth shares nothing with the layers: central differences of pictures cast by Embree, the same rays on
both sides, made twice with other rays. What the two differ by is its noise, taken out of both columns:

- projection: of the derivative on the truth; 1 is right.
- error: root-mean-square over that of the truth, over pixels and over means of 8 x 8 pixels.

`plain` is the derivative of what the same rays bring back, with visibility as it is: what differentiating a
tracer gives that does not know of silhouettes. Mitsuba's own derivatives are not in the table: its thin lens
has none by focus distance and aperture radius.

    python scripts/gradient_study.py --cache truths

`gradient_cost.py` measures what they cost.
"""

import argparse
import dataclasses
import hashlib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from _command_line import kept, make_parser, make_table
from _timing import timed
from jaxtyping import Array, Float
from rich.console import Console

from focusjax.baselines import RayScene, lens_picture
from focusjax.bench import Case, case_from_config
from focusjax.config import load_config
from focusjax.layers import Layers, peel
from focusjax.lens import TiltShiftLens, as_tilt_shift
from focusjax.trace import render
from focusjax.trace._picture import traced_picture
from focusjax.trace._render import render_settings

BLOCK = 8
PARAMETERS = ("focus", "aperture", "tilt")
CONFIGS = ("bars", "still_life", "town")
HEADINGS = (
    "scene", "by", "rays", "projection", "error", "8 x 8: projection", "8 x 8: error", "loss: error", "s",
)  # fmt: skip


def moved(lens: TiltShiftLens, values: Float[Array, "3"]) -> TiltShiftLens:
    """The lens with its focal disparity, log of the aperture radius and lean of the plane changed."""
    plane = lens.plane + jnp.stack([jnp.zeros(()), values[2], values[0]])
    radius = lens.aperture_radius * jnp.exp(values[1])
    return eqx.tree_at(lambda lens: (lens.plane, lens.aperture_radius), lens, (plane, radius))


def wide_case(path: Path, size: tuple[int, int], blur: float) -> tuple[Case, TiltShiftLens]:
    """The config's scene, through a lens that blurs the farthest or the nearest surface by `blur` pixels."""
    case = case_from_config(load_config(path), size)
    camera = case.camera
    layers = peel(case.scene, camera, case.lens, supersampling=1)
    least, largest = (float(w) for w in layers.ranges.overall)
    focus = float(case.lens.focus_disparity)
    reach = max(focus - least, largest - focus)
    radius = jnp.asarray(blur / (2.0 * float(camera.focal_px) * reach), dtype=float)
    return case, as_tilt_shift(dataclasses.replace(case.lens, aperture_radius=radius))


def steps(case: Case, lens: TiltShiftLens) -> np.ndarray:
    """Of each parameter for central differences: they change the blur by about a third of a pixel.

    Steps of a pixel make the differences of the bars a tenth smaller than the derivative.
    """
    gain = 2.0 * float(case.camera.focal_px) * float(lens.aperture_radius)
    return np.array([0.33 / gain, 0.03, 0.33 / gain / 0.25])


def truth(case: Case, lens: TiltShiftLens, rays: int, cache: Path | None) -> np.ndarray:
    """Two independent derivatives [2, h, w, 3, 3] by central differences of ray-cast pictures."""
    key = hashlib.sha256(f"{case.digest()} {lens.plane} {lens.aperture_radius} {rays}".encode())
    file = None if cache is None else cache / f"gradient_{case.name}_{key.hexdigest()[:16]}.npy"

    def differences() -> np.ndarray:
        ready = RayScene(case.scene)

        def picture(number: int, step: float, seed: int) -> np.ndarray:
            there = moved(lens, jnp.zeros(3).at[number].set(step))
            return lens_picture(ready, case.camera, there, rays=rays, seed=seed)

        def column(number: int, step: float, seed: int) -> np.ndarray:
            return (picture(number, step, seed) - picture(number, -step, seed)) / (2 * step)

        lengths = list(enumerate(steps(case, lens)))
        return np.stack([np.stack([column(*one, seed) for one in lengths], axis=-1) for seed in (0, 1)])

    return kept(file, differences)


def in_blocks(picture: np.ndarray) -> np.ndarray:
    """Means over squares of pixels; what does not fill one is left out."""
    height, width = (length // BLOCK * BLOCK for length in picture.shape[:2])
    cut = picture[:height, :width]
    return cut.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, -1).mean(axis=(1, 3))


def score(found: np.ndarray, truths: np.ndarray) -> tuple[float, float]:
    """Projection and relative error, without the truth's own noise."""
    first, second = truths
    mean, power = (first + second) / 2, (first * second).sum()
    noise = ((first - second) ** 2).sum() / 4
    error = ((found - mean) ** 2).sum() - noise
    return float((found * mean).sum() / power), float(np.sqrt(max(error, 0.0) / power))


def loss_error(found: np.ndarray, truths: np.ndarray, difference: np.ndarray) -> float:
    """Relative error of the derivative of half the squared difference from another picture."""
    expected = (difference * truths.mean(axis=0)).sum()
    return float(abs((difference * found).sum() - expected) / abs(expected))


@eqx.filter_jit
def jacobian(layers: Layers, lens: TiltShiftLens, rays: int) -> Float[Array, "h w 3 3"]:
    def picture(values: Float[Array, "3"]) -> Float[Array, "h w 3"]:
        return render(layers, moved(lens, values), even=True, rays=rays, derivative_rays=rays)

    return jax.jacfwd(picture)(jnp.zeros(3))


@eqx.filter_jit
def plain(layers: Layers, lens: TiltShiftLens, rays: int) -> Float[Array, "h w 3 3"]:
    def picture(values: Float[Array, "3"]) -> Float[Array, "h w 3"]:
        settings = render_settings(layers, lens, even=True, smooth=False, rays=rays)
        settings = dataclasses.replace(settings, emitters=False)
        picture = traced_picture(layers, moved(lens, values), jnp.uint32(0), settings)
        return picture.reshape(layers.camera.height, layers.camera.width, 3)

    return jax.jacfwd(picture)(jnp.zeros(3))


def study(path: Path, options: argparse.Namespace) -> list[list[str]]:
    """Rows of the table for one config."""
    size = tuple(int(side) for side in options.size.split("x"))
    case, lens = wide_case(path, (size[0], size[1]), options.blur)
    # Room for differences, and for the steps of whoever solves with them.
    widest = moved(lens, jnp.array([0.0, 0.1, 0.0]))
    layers = peel(case.scene, case.camera, widest, supersampling=options.supersampling, max_layers=32)
    truths = truth(case, lens, options.truth_rays, options.cache)
    # Another lens: a smaller opening, and a pixel more of blur by focus and by tilt.
    by_focus, _, by_tilt = 3.0 * steps(case, lens)
    other = moved(lens, jnp.array([by_focus, -0.2, by_tilt]))
    pictures = [np.asarray(render(layers, one, rays=256, smooth=False)) for one in (lens, other)]
    difference = pictures[0] - pictures[1]
    rows = {str(rays): timed(lambda rays=rays: jacobian(layers, lens, rays), 1) for rays in options.rays}
    most = options.rays[-1]
    rows[f"plain, {most}"] = timed(lambda: plain(layers, lens, most), 1)
    table = []
    for number, parameter in enumerate(PARAMETERS):
        for label, found in rows.items():
            one, true = np.asarray(found.result)[..., number], truths[..., number]
            whole = score(one, true)
            means = score(in_blocks(one), np.stack([in_blocks(t) for t in true]))
            scores = [f"{whole[0]:.3f}", f"{whole[1]:.2f}", f"{means[0]:.3f}", f"{means[1]:.3f}"]
            loss = f"{loss_error(one, true, difference):.3f}"
            table.append([case.name, parameter, label, *scores, loss, f"{found.median:.2f}"])
    return table


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument(
        "configs", nargs="*", type=Path, help="those in configs/ with a plain lens by default"
    )
    parser.add_argument("--size", default="80x60", help="pixels")
    parser.add_argument("--blur", type=float, default=12.0, help="widest blur in pixels")
    parser.add_argument("--supersampling", type=int, default=4, help="layer samples per pixel and axis")
    parser.add_argument("--rays", type=int, nargs="+", default=[64, 256], help="per pixel, border and rim")
    parser.add_argument("--truth-rays", type=int, default=3072, help="per pixel, twelve times over")
    parser.add_argument("--cache", type=Path, help="folder that keeps the truths")
    options = parser.parse_args()
    folder = Path(__file__).parent.parent / "configs"
    rows = []
    for path in options.configs or [folder / f"{name}.toml" for name in CONFIGS]:
        rows += study(path, options)
    title = f"{options.size}, blur up to {options.blur:g} px; seconds for all parameters together"
    table = make_table(title, *HEADINGS, left=2)
    for row in rows:
        table.add_row(*row)
    Console(width=max(120, Console().width)).print(table)


if __name__ == "__main__":
    main()
