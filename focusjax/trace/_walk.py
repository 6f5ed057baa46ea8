"""The first surface that one ray meets: a walk through the layers, at most a sample per step."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax.geometry import LensRay


class Volume(eqx.Module):
    """The layers as flat planes, in the form the walk reads them.

    Attributes:
        extent: packed disparity interval [n] of every sample of every layer.
        scale: dioptres per step of `extent`.
        columns: samples per row (static).
        rows: rows (static).
    """

    extent: UInt[Array, " n"]
    scale: Float[Array, ""]
    columns: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)


def first_hit(
    volume: Volume,
    ray: LensRay,
    least: Float[Array, ""],
    largest: Float[Array, ""],
    *,
    depth: int,
) -> Int[Array, ""]:
    """Index into `volume` of the first sample that `ray` (in grid units) meets; -1 if it meets none.

    The ray is walked from disparity `largest` to `least` in equal steps, each at most one sample long
    in x and y; a `largest` of 0 says that there is nothing to meet. A step lies in the sample under its
    middle, and meets a layer there when the step's disparities overlap the sample's; of several, the
    nearest counts. Only the first `depth` layers are looked at.
    """
    # Scalars, not 2-vectors, inside the loop: vmapped, they become whole arrays that XLA fuses into
    # one pass around the look-ups (four times quicker on a CPU).
    (a_x, a_y), (b_x, b_y) = ray.a, ray.b
    layer_size = volume.columns * volume.rows
    length = (largest - least) * jnp.maximum(jnp.abs(b_x), jnp.abs(b_y))
    steps = jnp.where(largest > 0, length.astype(jnp.int32) + 1, 0)
    stride = (largest - least) / jnp.maximum(steps, 1).astype(largest.dtype)
    per_dioptre = 1.0 / volume.scale

    def unfinished(state: tuple[Int[Array, ""], Int[Array, ""]]) -> Bool[Array, ""]:
        step, hit = state
        return (step < steps) & (hit < 0)

    def advance(state: tuple[Int[Array, ""], Int[Array, ""]]) -> tuple[Int[Array, ""], Int[Array, ""]]:
        step, _ = state
        near = largest - step.astype(largest.dtype) * stride
        middle = near - 0.5 * stride
        column = jnp.clip((a_x + b_x * middle).astype(jnp.int32), 0, volume.columns - 1)
        row = jnp.clip((a_y + b_y * middle).astype(jnp.int32), 0, volume.rows - 1)
        sample = row * volume.columns + column
        nearest = (near * per_dioptre).astype(jnp.int32) + 1
        farthest = ((near - stride) * per_dioptre).astype(jnp.int32)
        best, hit = jnp.int32(0), jnp.int32(-1)
        for layer in range(depth):
            index = sample + layer * layer_size
            extent = volume.extent.at[index].get(mode="promise_in_bounds")
            most, low = (extent >> 16).astype(jnp.int32), (extent & 0xFFFF).astype(jnp.int32)
            meets = (low <= nearest) & (most >= farthest) & (most > best)
            best = jnp.where(meets, most, best)
            hit = jnp.where(meets, index, hit)
        return step + 1, hit

    return jax.lax.while_loop(unfinished, advance, (jnp.int32(0), jnp.int32(-1)))[1]
