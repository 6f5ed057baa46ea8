"""What derivatives of pictures cost beside the pictures, in time and in memory.

Times are of this process's processors, in alternating turns, so that other work on the machine disturbs
ratios little. Derivatives are by focus, aperture and tilt together, forwards along one direction and in
reverse of a sum of squares, with the default of half as many rays per border and rim.

    python scripts/gradient_cost.py configs/bars.toml --rays 32 64
    python scripts/gradient_cost.py configs/town.toml --memory --size 800x600 --rays 32 --layers 4
"""

import functools
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from _command_line import make_parser, make_table
from _timing import timed_in_turns
from gradient_study import moved, wide_case
from jaxtyping import Array, Float
from rich.console import Console

from focusjax.bench._measure import peak_memory
from focusjax.layers import Layers, peel
from focusjax.lens import TiltShiftLens
from focusjax.trace import render


@eqx.filter_jit
def picture(layers: Layers, lens: TiltShiftLens, rays: int) -> Float[Array, "h w 3"]:
    return render(layers, lens, even=True, rays=rays)


@eqx.filter_jit
def along(layers: Layers, lens: TiltShiftLens, rays: int) -> Float[Array, "h w 3"]:
    def by_settings(values: Float[Array, "3"]) -> Float[Array, "h w 3"]:
        return render(layers, moved(lens, values), even=True, rays=rays)

    return jax.jvp(by_settings, (jnp.zeros(3),), (jnp.ones(3),))[1]


@eqx.filter_jit
def back(layers: Layers, lens: TiltShiftLens, rays: int) -> Float[Array, "3"]:
    def loss(values: Float[Array, "3"]) -> Float[Array, ""]:
        return (render(layers, moved(lens, values), even=True, rays=rays) ** 2).sum()

    return jax.grad(loss)(jnp.zeros(3))


WAYS: dict[str, Callable[..., Array]] = {"picture": picture, "jvp": along, "vjp": back}


def seconds(layers: Layers, lens: TiltShiftLens, rays: int, turns: int) -> dict[str, float]:
    """Median processor seconds of each way after the first call."""
    runs = {name: functools.partial(way, layers, lens, rays) for name, way in WAYS.items()}
    return {name: found.cpu_median for name, found in timed_in_turns(runs, turns).items()}


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("config", type=Path)
    parser.add_argument("--size", default="128x96", help="pixels")
    parser.add_argument("--blur", type=float, default=16.0, help="widest blur in pixels")
    parser.add_argument("--supersampling", type=int, default=2, help="layer samples per pixel and axis")
    parser.add_argument("--layers", type=int, default=32, help="at most")
    parser.add_argument("--rays", type=int, nargs="+", default=[32])
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--memory", action="store_true", help="one gradient, and the process's peak memory")
    options = parser.parse_args()
    width, height = (int(side) for side in options.size.split("x"))
    case, lens = wide_case(options.config, (width, height), options.blur)
    widest = moved(lens, jnp.array([0.0, 0.1, 0.0]))
    layers = peel(
        case.scene, case.camera, widest, supersampling=options.supersampling, max_layers=options.layers
    )
    if options.memory:
        before = peak_memory()
        gradient = back(layers, lens, options.rays[0]).block_until_ready()
        print(
            f"{case.name}, {options.size}, {options.rays[0]} rays, {layers.filled} layers: peak"
            f" {before / 1024:.2f} GiB with the layers, {peak_memory() / 1024:.2f} GiB after a gradient"
            f" {np.asarray(gradient)}"
        )
        return
    title = f"{case.name}, {options.size}, {layers.filled} layers: processor time in pictures"
    table = make_table(title, "rays", "picture s", "jvp", "vjp", left=0)
    for rays in options.rays:
        spent = seconds(layers, lens, rays, options.turns)
        base = spent["picture"]
        table.add_row(str(rays), f"{base:.2f}", f"{spent['jvp'] / base:.1f}", f"{spent['vjp'] / base:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
