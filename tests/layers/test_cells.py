"""Packed samples: their interval covers what it should, their line leaves the share that it should."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.layers._cells import (
    STEPS,
    WHOLE,
    covered,
    in_steps,
    interval,
    line_code,
    pack_cells,
)


def test_packed_intervals_hold_what_they_were_given_and_little_more():
    random = np.random.default_rng(0)
    low = random.uniform(0.0, 2.0, 500)
    high = low + 10.0 ** random.uniform(-5, 0.3, low.shape)
    *steps, scale = in_steps(low, high)
    words = pack_cells(*steps, np.full(low.shape, WHOLE, dtype=np.uint16))
    least, most = (np.asarray(a) for a in interval(jnp.asarray(words)))
    assert (words > 0).all()
    assert (least * scale <= low + 1e-12).all()
    assert (most * scale >= high - 1e-12).all()
    assert (most * scale - high < scale).all()
    # Three significant bits: less than a quarter longer, or two steps.
    longer = (most - least) * scale - (high - low)
    assert (longer <= np.maximum(3 * scale, 0.25 * (high - low) + 4 * scale)).all()


def test_every_length_is_rounded_up_to_one_that_is_kept():
    length = np.arange(STEPS)
    high = np.full(STEPS, float(STEPS))
    *steps, scale = in_steps(high - length, high)
    words = pack_cells(*steps, np.full(STEPS, WHOLE, dtype=np.uint16))
    assert scale == 1.0
    least, most = (np.asarray(a) for a in interval(jnp.asarray(words)))
    kept = most - least
    assert (kept >= length).all()
    assert (kept <= 1.25 * length + 1).all()
    assert (kept[:5] == [0, 1, 2, 3, 4]).all()


def inside(code: int, count: int = 200) -> np.ndarray:
    """Points of a fine grid over the square [count, count] that the line leaves inside."""
    y, x = (np.mgrid[:count, :count] + 0.5) / count - 0.5
    return np.asarray(covered(jnp.full(x.shape, code, dtype=jnp.uint32), jnp.asarray(x), jnp.asarray(y)))


def test_a_whole_square_reaches_beyond_itself():
    y, x = np.mgrid[-1:1:21j, -1:1:21j]
    words = jnp.full(x.shape, WHOLE, dtype=jnp.uint32)
    assert np.asarray(covered(words, jnp.asarray(x), jnp.asarray(y))).all()


@pytest.mark.parametrize("area", [0.03, 0.2, 0.5, 0.71, 0.96])
def test_lines_leave_their_share_on_the_right_side(area: float):
    angles = np.arange(0, 2 * np.pi, np.pi / 17)
    towards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for direction, code in zip(towards, line_code(towards, np.full(len(angles), area)), strict=True):
        kept = inside(int(code))
        # Observed: 0.036, a step of the offset being a fourteenth of a sample.
        assert abs(kept.mean() - area) < 0.04
        y, x = (np.mgrid[:200, :200] + 0.5) / 200 - 0.5
        centroid = np.array([x[kept].sum(), y[kept].sum()])
        assert centroid @ direction >= 0.8 * np.linalg.norm(centroid)


def test_no_direction_still_leaves_the_share():
    code = line_code(np.zeros((1, 2)), np.array([0.25]))[0]
    assert abs(inside(int(code)).mean() - 0.25) < 0.04
