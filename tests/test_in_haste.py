"""Programs that are compiled in haste do what others do, wherever they are called."""

import jax
import jax.numpy as jnp
import numpy as np

from focusjax import _in_haste
from focusjax._in_haste import jit_in_haste


@jit_in_haste
def cubed(x):
    """The third power."""
    return x**3


def test_it_is_the_function_inside_other_programs_and_alone():
    assert cubed.__doc__ == "The third power."
    np.testing.assert_allclose(cubed(jnp.array(2.0)), 8.0)
    np.testing.assert_allclose(jax.grad(cubed)(2.0), 12.0)
    np.testing.assert_allclose(jax.jit(jax.grad(cubed))(2.0), 12.0)
    np.testing.assert_allclose(jax.vmap(cubed)(jnp.arange(3.0)), [0.0, 1.0, 8.0])


def test_an_option_that_this_version_does_not_know_is_left_out(monkeypatch):
    monkeypatch.setattr(_in_haste, "_OPTIONS", {"xla_no_such_option": 1})
    _in_haste._options_are_known.cache_clear()
    try:
        assert not _in_haste._options_are_known()
        np.testing.assert_allclose(jit_in_haste(lambda x: x + 1.0)(jnp.array(1.0)), 2.0)
    finally:
        monkeypatch.undo()
        _in_haste._options_are_known.cache_clear()
