"""Positions in compact arrays, against a count of what comes before."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.layers._places import make_places


@pytest.mark.parametrize("share", [0.0, 0.02, 0.6, 1.0])
@pytest.mark.parametrize("size", [1, 31, 64, 1000])
def test_numbers_count_the_samples_before(size: int, share: float):
    there = np.random.default_rng(size).random(size) < share
    held = np.flatnonzero(there)
    shuffled = np.random.default_rng(1).permutation(held)
    places, number = make_places(size, shuffled)
    np.testing.assert_array_equal(number, np.searchsorted(held, shuffled))
    np.testing.assert_array_equal(places.number(jnp.asarray(held, dtype=jnp.int32)), np.arange(len(held)))
