"""How radiance changes across the square of each sample, from the samples around it."""

from collections.abc import Callable
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax._at_once import at_once
from focusjax._programs import jit
from focusjax._zeros import zeros_after
from focusjax.layers._joins import NEIGHBOURS, SAME_LAYER, UNJOINED
from focusjax.layers._layers import Layers
from focusjax.layers._rows import in_turns

_OPPOSITE = ((0, 1), (2, 3))
"""Right and left, below and above among the neighbours."""
_Colour: TypeAlias = tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]


@jit
def radiance_slopes(layers: Layers) -> tuple[_Colour, _Colour]:
    """Change of the radiance of `layers.samples` per sample to the right, and downwards; each [n] a colour.

    A sample's radiance is the mean over its square. With half the step between its two neighbours,

        L(dx, dy) = L + dx (L_right - L_left) / 2 + dy (L_below - L_above) / 2,    |dx|, |dy| <= 1/2,

    has the same mean and is wrong to second order only (van Leer 1979), so that what is seen out of focus
    keeps its place and its width, and a pixel in focus is the mean over its area. Where a neighbour does not
    continue the surface there is no change in that direction. Slopes are lowered where L(dx, dy) would be
    negative in a corner, in each colour by itself.

    Differentiable in the radiance; its zeros follow the last sample.
    """
    samples, columns = layers.samples, layers.grid.columns
    radiance = samples.radiance
    size = columns * layers.grid.rows

    def of_sample(sample: tuple[Array, Array, Array]) -> tuple[_Colour, _Colour]:
        number, links, index = sample

        def step(after: int, before: int) -> list[Float[Array, ""]]:
            (joined, there), (joined_too, back) = neighbour(after), neighbour(before)
            return [
                jnp.where(joined & joined_too, 0.5 * (radiance[there, k] - radiance[back, k]), 0.0)
                for k in range(3)
            ]

        def neighbour(side: int) -> tuple[Bool[Array, ""], Int[Array, ""]]:
            dx, dy = NEIGHBOURS[side]
            code = ((links >> (4 * side)) & 15).astype(jnp.int32)
            there = index + jnp.where(code == UNJOINED, 0, (code - SAME_LAYER) * size + dy * columns + dx)
            return code != UNJOINED, layers.places.number(there)

        across, down = (step(*sides) for sides in _OPPOSITE)
        shares = [_positive(radiance[number, k], across[k], down[k]) for k in range(3)]
        red, green, blue = ((x * by, y * by) for x, y, by in zip(across, down, shares, strict=True))
        return (red[0], green[0], blue[0]), (red[1], green[1], blue[1])

    numbers = jnp.arange(len(radiance), dtype=jnp.int32)
    return _in_blocks(of_sample, (numbers, samples.links, samples.index), radiance)


def _in_blocks(
    of_sample: Callable[[tuple[Array, Array, Array]], tuple[_Colour, _Colour]],
    columns: tuple[Array, Array, Array],
    radiance: Float[Array, "n 3"],
) -> tuple[_Colour, _Colour]:
    """What is found of every row of `columns`, some at a time, to hold little at once."""
    count = len(radiance)
    some = min(count, at_once(cpu=1 << 16, gpu=1 << 22))
    if some == count:
        return jax.vmap(of_sample)(columns)

    def block(first: Int[Array, ""]) -> tuple[_Colour, _Colour]:
        rows = jax.tree.map(lambda a: jax.lax.dynamic_slice_in_dim(a, first, some), columns)
        return jax.vmap(of_sample)(rows)

    nothing = zeros_after(radiance, (count,), radiance.dtype)
    return in_turns(block, ((nothing, nothing, nothing), (nothing, nothing, nothing)), count, some)


def _positive(own: Float[Array, ""], x: Float[Array, ""], y: Float[Array, ""]) -> Float[Array, ""]:
    """By what slopes are multiplied to leave no corner of a square negative."""
    most = 2.0 * jnp.maximum(own, 0.0)
    total = jnp.abs(x) + jnp.abs(y)
    return jnp.where(total > most, most / jnp.where(total > most, total, 1.0), 1.0)
