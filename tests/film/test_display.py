"""Display encoding against the values of the standard."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.film import encode_srgb, expose, to_bytes, to_words


def decode(signal: np.ndarray) -> np.ndarray:
    return np.where(signal <= 0.04045, signal / 12.92, ((signal + 0.055) / 1.055) ** 2.4)


def test_known_values():
    # 18 % grey is 46.1 % signal; the ends stay where they are.
    signal = encode_srgb(jnp.array([0.0, 0.18, 1.0]))
    np.testing.assert_allclose(signal, [0.0, 0.46136, 1.0], atol=1e-5)  # observed 2e-6


def test_inverse_of_decoding():
    signal = np.linspace(0, 1, 256)
    np.testing.assert_allclose(encode_srgb(jnp.asarray(decode(signal))), signal, atol=1e-7)  # observed 3e-8


def test_gradient_is_finite_at_black_and_matches_differences():
    gradient = jax.vmap(jax.grad(encode_srgb))(jnp.array([0.0, 0.001, 0.5]))
    step = 1e-6
    middle = (encode_srgb(jnp.array([0.001, 0.5]) + step) - encode_srgb(jnp.array([0.001, 0.5]) - step)) / (
        2 * step
    )
    np.testing.assert_allclose(gradient[0], 12.92)
    np.testing.assert_allclose(gradient[1:], middle, rtol=1e-8)  # observed 3e-10


def test_a_stop_doubles():
    np.testing.assert_allclose(expose(jnp.array([0.25]), 1.0), [0.5])


@pytest.mark.parametrize(("encode", "top"), [(to_bytes, 255), (to_words, 65535)])
def test_integers_cover_the_range_and_cut_beyond_it(encode, top):
    image = jnp.broadcast_to(jnp.array([-1.0, 0.0, 7.0]), (2, 3, 3))
    np.testing.assert_array_equal(encode(image)[0, 0], [0, 0, top])


def test_float32_stays_float32():
    assert encode_srgb(jnp.ones(3, jnp.float32)).dtype == jnp.float32
    assert expose(jnp.ones(3, jnp.float32), 0.5).dtype == jnp.float32
