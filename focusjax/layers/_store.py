"""Large arrays of which little is written: untouched pages of memory cost neither time nor room."""

import math

import jax
import numpy as np
from jaxtyping import Array

_ALIGNMENT = 64
"""Bytes; a device on the same processor takes arrays aligned like this as they are, without a copy."""


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
