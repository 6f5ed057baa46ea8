"""Sums and extremes over few terms are those of numpy."""

import jax.numpy as jnp
import numpy as np

from focusjax._few import largest_of_few, least_of_few, sum_of_few


def test_they_are_those_along_the_first_axis():
    terms = np.random.default_rng(0).normal(size=(5, 3, 2))
    given = jnp.asarray(terms)
    # Observed 4e-16: terms are added in another order.
    np.testing.assert_allclose(sum_of_few(given), terms.sum(axis=0), atol=4e-15)
    np.testing.assert_array_equal(least_of_few(given), terms.min(axis=0))
    np.testing.assert_array_equal(largest_of_few(given), terms.max(axis=0))


def test_one_term_is_itself():
    only = jnp.array([[2.0, -3.0]])
    for of_few in (sum_of_few, least_of_few, largest_of_few):
        np.testing.assert_array_equal(of_few(only), only[0])
