"""Large arrays of which little is written, and where in compact arrays the values of a sparse grid lie.

Layers hold about one sample per pixel and have room for many: all but what the walk reads at every step is
kept for the samples that are there, in the order of their flat index. The number of a sample in that order
is how many there are before it: a count for every 32 places, and a bit for each place (Jacobson 1989). What
is as long as the grid has untouched pages of memory, which cost neither time nor room.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import population_count
from jaxtyping import Array, Int, UInt

from focusjax._whole import taken

_ALIGNMENT = 64
"""Bytes; a device on the same processor takes arrays aligned like this as they are, without a copy."""
_BITS = 32


def zeros(shape: tuple[int, ...], dtype: np.dtype | type) -> np.ndarray:
    """As numpy's, at an address that `jax.device_put` needs not copy from."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.zeros(size + _ALIGNMENT, dtype=np.uint8)
    start = -raw.ctypes.data % _ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)


def scattered(shape: tuple[int, ...], index: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """`samples` [n, ...] at the flat places `index` of an array of `shape`, 0 elsewhere."""
    out = zeros((*shape, *samples.shape[1:]), samples.dtype)
    rows = out.reshape(-1, *samples.shape[1:])
    if samples.ndim > 1:
        # A row at once: numpy takes twice the time for the numbers of each.
        row = np.dtype((np.void, samples[:1].nbytes))
        rows.view(row)[:, 0][index] = np.ascontiguousarray(samples).view(row)[:, 0]
    else:
        rows[index] = samples
    return out


def on_device(array: np.ndarray) -> Array:
    """The array for compiled programs; it must not be written to any more."""
    return jax.device_put(array)


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
        held = taken(self.held, word)
        before = taken(self.before, word)
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
