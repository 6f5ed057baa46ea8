"""Range queries against brute force."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.layers import RangePyramid
from focusjax.layers._cells import STEPS, in_steps
from focusjax.layers._pyramid import build_ranges

SHAPE = (3, 22, 30)


@cache
def planes() -> tuple[np.ndarray, np.ndarray]:
    """Least and largest disparity [l, h, w] of sparse random samples."""
    random = np.random.default_rng(4)
    held = random.random(SHAPE) < 0.08
    low = np.where(held, random.integers(100, 5000, SHAPE), 0)
    high = np.where(held, low + random.integers(0, 1000, SHAPE), 0)
    # The largest makes a step 1 dioptre, so that nothing is rounded.
    high[np.unravel_index(np.argmax(high), SHAPE)] = STEPS
    return low.astype(np.float64), high.astype(np.float64)


def pyramid(block: int, widest: float = 16.0) -> RangePyramid:
    low, high = planes()
    _, row, column = np.nonzero(high)
    cell, held = row * SHAPE[2] + column, high > 0
    least, most, scale = in_steps(low[held], high[held])
    shape, real = SHAPE[1:], low.dtype
    return build_ranges(cell, least, most, scale, shape=shape, block=block, widest=widest, real=real)


@eqx.filter_jit
def ask(ranges: RangePyramid, low: jnp.ndarray, high: jnp.ndarray) -> tuple[jnp.ndarray, ...]:
    return jax.vmap(ranges.query)(low, high)


def brute(first: np.ndarray, last: np.ndarray) -> tuple[float, float, int]:
    """Extremes and layer count over the samples from `first` to `last` (x, y), both included."""
    low, high = (a[:, max(first[1], 0) : last[1] + 1, max(first[0], 0) : last[0] + 1] for a in planes())
    held = high > 0
    return (
        low[held].min() if held.any() else STEPS + 1,
        high[held].max() if held.any() else 0.0,
        int(held.sum(axis=0).max(initial=0)),
    )


def boxes(count: int, largest: float) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(7)
    size = np.array([SHAPE[2], SHAPE[1]])
    low = random.uniform(0, 1, (count, 2)) * (size - 0.01)
    return low, np.minimum(low + random.uniform(0, largest, (count, 2)), size - 0.01)


def covering(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last block of the squares, set at both ends of each side, that answer a box."""
    level = int(np.log2((last - first + 1).max()))
    coarse = max(level - 2, 0)
    width = 1 << level if level <= 2 else 5 << coarse
    second = np.maximum(last + 1 - (1 << level), first)
    return first >> coarse << coarse, (second >> coarse << coarse) + width - 1


@pytest.mark.parametrize("block", [1, 2, 3])
def test_queries_are_the_extremes_over_their_squares(block: int):
    """Brute force over the box, rounded outwards to blocks and to a square of 2^i blocks at least."""
    low, high = boxes(300, 15.0)
    answers = (np.asarray(a) for a in ask(pyramid(block), jnp.asarray(low), jnp.asarray(high)))
    for (least, largest, deepest), one, other in zip(zip(*answers, strict=True), low, high, strict=True):
        first, last = np.floor(one / block).astype(int), np.floor(other / block).astype(int)
        # With blocks, the last row and column of them may stick out of the grid.
        start, end = covering(first, last)
        expected = brute(start * block, end * block + block - 1)
        assert (least, largest, deepest) == expected
        inner = brute(np.floor(one).astype(int), np.floor(other).astype(int))
        assert least <= inner[0]
        assert largest >= inner[1]
        assert deepest >= inner[2]


def test_boxes_beyond_the_grid_are_cut_off_at_it():
    low, high = (
        np.array([(-5.0, -7.5), (25.0, 3.0), (-3.0, 18.2)]),
        np.array([(3.2, 2.0), (99.0, 9.0), (4.0, 70.0)]),
    )
    answers = [np.asarray(a) for a in ask(pyramid(1), jnp.asarray(low), jnp.asarray(high))]
    for k in range(3):
        first = np.maximum(np.floor(low[k]).astype(int), 0)
        last = np.minimum(np.floor(high[k]).astype(int), [SHAPE[2] - 1, SHAPE[1] - 1])
        assert tuple(a[k] for a in answers) == brute(*covering(first, last))


def test_too_large_a_box_is_answered_for_everything():
    ranges = pyramid(1, widest=2.0)
    assert len(ranges.shapes) == 3
    everything = brute(np.array([0, 0]), np.array([SHAPE[2], SHAPE[1]]))
    least, largest, deepest = ask(ranges, jnp.array([[3.0, 3.0]]), jnp.array([[20.0, 20.0]]))
    assert (float(least[0]), float(largest[0]), int(deepest[0])) == everything
    assert (float(ranges.overall[0]), float(ranges.overall[1]), int(ranges.most_layers)) == everything
