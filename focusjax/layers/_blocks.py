"""Compiled programs over arrays of any length, in blocks of one shape, so that few are compiled."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from focusjax._parallel import in_parallel, parts


def padded_length(count: int) -> int:
    """The next power of two, so that few different shapes are ever compiled."""
    return 1 << max(count - 1, 0).bit_length()


def coarse_number(count: int, step: int) -> int:
    """The next power of two up to `step`, the next multiple of it beyond: few numbers, none far above."""
    return padded_length(count) if count <= step else -(-count // step) * step


def pad_rows(array: np.ndarray, length: int) -> np.ndarray:
    """`array` with rows of zeros added up to `length`, to keep compiled shapes few."""
    if len(array) == length:
        return array
    return np.concatenate([array, np.zeros((length - len(array), *array.shape[1:]), dtype=array.dtype)])


def in_blocks(program: Callable[..., Any], columns: Sequence[np.ndarray], at_once: int) -> Any:
    """What `program` makes of `columns` [n, ...], row by row, on all cores; a tree of arrays [n, ...].

    It is given `at_once` rows at a time, zeros added to the last ones.
    """

    def block(part: slice) -> Any:
        made = program(*jax.device_put([pad_rows(column[part], at_once) for column in columns]))
        return jax.tree.map(lambda a: np.asarray(a)[: part.stop - part.start], made)

    blocks = in_parallel(block, parts(len(columns[0]), at_once))
    if not blocks:
        shapes = jax.eval_shape(program, *(pad_rows(column, at_once) for column in columns))
        return jax.tree.map(lambda a: np.zeros((0, *a.shape[1:]), dtype=a.dtype), shapes)
    return jax.tree.map(lambda *a: np.concatenate(a), *blocks)
