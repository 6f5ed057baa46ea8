"""Where in compact arrays the values of a sparse grid lie.

Layers hold about one sample per pixel and have room for many: all but what the walk reads at every step is
kept for the samples that are there, in the order of their flat index. The number of a sample in that order
is how many there are before it: a count for every 32 places, and a bit for each place (Jacobson 1989).
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.lax import population_count
from jaxtyping import Array, Int, UInt

from focusjax.layers._store import on_device, zeros

_BITS = 32


class Places(eqx.Module):
    """Which of the places on the grid of all layers hold a sample.

    Attributes:
        held: a bit [m] for each place, 32 to a word, the first one lowest.
        before: number of samples [m] in the words before.
    """

    held: UInt[Array, " m"]
    before: Int[Array, " m"]

    def number(self, index: Int[Array, "*n"]) -> Int[Array, "*n"]:
        """Position in compact arrays of the samples at flat `index` [n]; of no meaning where none is."""
        word = index >> 5
        below = (jnp.uint32(1) << (index & (_BITS - 1)).astype(jnp.uint32)) - 1
        held = self.held.at[word].get(mode="promise_in_bounds")
        before = self.before.at[word].get(mode="promise_in_bounds")
        return before + population_count(held & below).astype(jnp.int32)


def make_places(size: int, index: Int[np.ndarray, " n"]) -> tuple[Places, Int[np.ndarray, " n"]]:
    """The samples at the flat places `index`, all different, of `size`; and the number of each of them."""
    there = zeros((-(-size // _BITS) * _BITS,), bool)
    there[index] = True
    held = np.packbits(there, bitorder="little").view(np.uint32)
    count = np.bitwise_count(held).astype(np.int32)
    before = np.cumsum(count, dtype=np.int32) - count
    below = (np.uint32(1) << (index & (_BITS - 1)).astype(np.uint32)) - np.uint32(1)
    word = index >> 5
    number = np.take(before, word) + np.bitwise_count(np.take(held, word) & below)
    return Places(on_device(held), on_device(before)), number.astype(np.int64)
