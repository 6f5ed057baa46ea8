"""Work on the grid of layers in bands of rows, so that what it needs meanwhile is that of one band."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt

from focusjax._at_once import at_once
from focusjax._zeros import zeros_after
from focusjax.layers._layers import Layers

_Rows = TypeVar("_Rows")


class RowsOfLayers(eqx.Module):
    """Some rows of layers.

    Attributes:
        layers: all of them.
        first: number of the first row.
        count: how many rows (static).
    """

    layers: Layers
    first: Int[Array, ""]
    count: int = eqx.field(static=True)

    @property
    def cells(self) -> UInt[Array, "l r w"]:
        """Packed interval and outline of each sample, 0 where nothing is."""
        return jax.lax.dynamic_slice_in_dim(self.layers.cells, self.first, self.count, axis=1)

    @property
    def background(self) -> Float[Array, "r w 3"] | Float[Array, "3"]:
        """Radiance at infinity; one where it is the same all over."""
        whole = self.layers.background
        if whole.ndim == 1:
            return whole
        return jax.lax.dynamic_slice_in_dim(whole, self.first, self.count, axis=0)

    def spread(self, values: Array, fill: float, depth: int | None = None) -> Array:
        """Values [n, ...] of the layers' samples at their places [l, r, w, ...], `fill` where none is.

        Of the first `depth` layers; of all if not given.
        """
        rows, columns = self.layers.cells.shape[1:]
        cells = self.cells[:depth]
        layer, row, column = (jnp.arange(size, dtype=jnp.int32) for size in cells.shape)
        index = (layer[:, None, None] * rows + (self.first + row)[None, :, None]) * columns
        number = self.layers.places.number(index + column[None, None])
        there = (cells > 0).reshape(*cells.shape, *[1] * (values.ndim - 1))
        return jnp.where(there, values[number], jnp.asarray(fill, dtype=values.dtype))


def by_rows(
    layers: Layers, function: Callable[[RowsOfLayers], Float[Array, "r w c"]]
) -> Float[Array, "h w c"]:
    """What `function` makes of the rows of `layers`, some of them at a time."""
    _, rows, columns = layers.cells.shape
    samples = at_once(cpu=1 << 17, gpu=1 << 22)
    count = min(max(1, samples // columns), rows)
    if count == rows:
        return function(RowsOfLayers(layers, jnp.int32(0), rows))
    shape = jax.eval_shape(lambda: function(RowsOfLayers(layers, jnp.int32(0), count)))
    nothing = zeros_after(layers.samples.radiance, (rows, *shape.shape[1:]), shape.dtype)

    return in_turns(lambda first: function(RowsOfLayers(layers, first, count)), nothing, rows, count)


def in_turns(function: Callable[[Int[Array, ""]], _Rows], nothing: _Rows, length: int, count: int) -> _Rows:
    """What `function` makes of `count` of `length` rows from a first one on, put together from `nothing`."""

    def add(whole: _Rows, number: Int[Array, ""]) -> tuple[_Rows, None]:
        # The last turn shares rows with the one before.
        first = jnp.minimum(number * count, length - count)
        return jax.tree.map(
            lambda a, new: jax.lax.dynamic_update_slice_in_dim(a, new, first, axis=0), whole, function(first)
        ), None

    return jax.lax.scan(add, nothing, jnp.arange(-(-length // count), dtype=jnp.int32))[0]
