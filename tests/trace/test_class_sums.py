"""Sums by class of blur are kept where there is something, and lose nothing."""

import numpy as np
from scipy.sparse import csr_array

from focusjax.trace._class_sums import added_up, by_class

ROWS, NUMBERS = 50, 11


def test_parts_add_up_to_the_sums_of_their_rows():
    """Blocks of some rows each, which others have as well, of which most numbers are 0."""
    chance = np.random.default_rng(4)
    parts, whole = [], np.zeros((ROWS, NUMBERS))
    for size in (13, 1, 29, 50):
        rows = chance.choice(ROWS, size, replace=False)
        values = chance.uniform(size=(size, NUMBERS)) * (chance.uniform(size=(size, NUMBERS)) < 0.3)
        whole[rows] += values
        parts.append((rows, csr_array(values)))
    found = added_up(parts, (ROWS, NUMBERS), np.dtype(np.float64))
    assert found.nnz == sum(part.nnz for _, part in parts)
    np.testing.assert_allclose(found.toarray(), whole, atol=1e-15)
    of_classes, over = by_class(found)
    np.testing.assert_allclose(of_classes.toarray(), whole[:, :-3], atol=1e-15)
    np.testing.assert_allclose(over, whole[:, -3:], atol=1e-15)
    np.testing.assert_allclose(found @ np.ones(NUMBERS), whole.sum(axis=1), atol=1e-14)


def test_nothing_adds_up_to_nothing():
    found = added_up([], (ROWS, NUMBERS), np.dtype(np.float32))
    assert found.dtype == np.float32
    assert not found.toarray().any()
