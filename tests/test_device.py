"""Known numbers as arrays of JAX: as `jnp.asarray` makes them, without a program for every shape."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax._device import device_array


@pytest.mark.parametrize(
    ("values", "dtype"),
    [
        (np.arange(6.0).reshape(2, 3), None),
        (np.arange(7), jnp.float32),
        (np.array([True, False]), None),
        ([1, 2, 3], float),
        (2.5, float),
        (jnp.arange(3), float),
    ],
)
@pytest.mark.parametrize("wide", [True, False])
def test_as_asarray(values, dtype, wide):
    with jax.enable_x64(wide):
        found, expected = device_array(values, dtype), jnp.asarray(values, dtype=dtype)
        assert (found.dtype, found.weak_type) == (expected.dtype, False)
        np.testing.assert_array_equal(found, expected)


def test_new_shapes_do_not_compile(caplog):
    with jax.log_compiles():
        device_array(np.zeros((13, 17)), dtype=float)
    assert "Compiling" not in caplog.text


def test_values_are_copied():
    values = np.zeros(64)
    found = device_array(values)
    values[:] = 1.0
    assert not np.asarray(found).any()


def test_traced_values_stay_traced():
    slope = jax.grad(lambda value: jnp.sum(device_array(value, dtype=float) ** 2))(jnp.ones(3))
    np.testing.assert_array_equal(slope, 2.0)


@pytest.mark.parametrize(
    ("value", "dtype", "error"),
    [(2**40, jnp.int32, OverflowError), (float("nan"), jnp.int32, ValueError), (1j, float, TypeError)],
)
def test_what_does_not_fit_is_refused(value, dtype, error):
    for make in (device_array, jnp.asarray):
        with pytest.raises(error):
            make(value, dtype)
