"""Numbers that are at least 0 are looked up and divided as numpy does it."""

import jax
import jax.numpy as jnp
import numpy as np

from focusjax._whole import divided, taken


def test_what_is_taken_is_what_the_array_holds():
    values = np.random.default_rng(0).normal(size=50)
    index = np.random.default_rng(1).integers(0, 50, (3, 7))
    np.testing.assert_array_equal(jax.jit(taken)(jnp.asarray(values), jnp.asarray(index)), values[index])


def test_what_is_taken_several_times_has_the_sum_of_the_derivatives():
    slope = jax.grad(lambda values: taken(values, jnp.array([2, 0, 2])) @ jnp.array([1.0, 10.0, 100.0]))
    np.testing.assert_array_equal(slope(jnp.zeros(4)), [10.0, 0.0, 101.0, 0.0])


def test_quotient_and_rest_are_those_of_numpy():
    numbers = np.array([0, 1, 639, 640, 641, 2**31 - 1], dtype=np.int32)
    for by in (1, 7, 640):
        for found, known in zip(divided(jnp.asarray(numbers), by), np.divmod(numbers, by), strict=True):
            assert found.dtype == jnp.int32
            np.testing.assert_array_equal(found, known)


def test_divisors_may_be_traced():
    quotient, rest = jax.jit(divided)(jnp.arange(20), jnp.int32(6))
    np.testing.assert_array_equal(quotient * 6 + rest, np.arange(20))
    np.testing.assert_array_equal(rest, np.arange(20) % 6)
