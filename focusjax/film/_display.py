"""Display encoding: the one place where linear radiance becomes what a screen shows."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8, UInt16

from focusjax._device import device_array
from focusjax._programs import jit


def expose(image: Float[Array, "*shape"], stops: float) -> Float[Array, "*shape"]:
    """Linear `image` times 2 ** `stops`: one stop more doubles the light.

    Example:
        >>> fj.expose(jnp.array([0.25, 0.5]), 1.0).tolist()
        [0.5, 1.0]
    """
    return image * jnp.asarray(2.0**stops, dtype=image.dtype)


def encode_srgb(linear: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """SRGB signal from linear light (IEC 61966-2-1); 0 to 1 maps to 0 to 1.

    Values above 1 keep following the curve and negative ones stay linear, so nothing is lost.
    Differentiable everywhere but at the joint of the two branches, where the slopes differ by 0.1 %.
    """
    curved = linear > 0.0031308
    # The unused branch of a where still has a gradient, so it must not meet zero.
    safe = jnp.where(curved, linear, 1.0)
    return jnp.where(curved, 1.055 * safe ** (1 / 2.4) - 0.055, 12.92 * linear)


def to_bytes(image: Float[Array, "h w 3"], *, exposure: float = 0.0) -> UInt8[np.ndarray, "h w 3"]:
    """Linear `image` [h, w, 3] as 8-bit sRGB: exposed by stops, encoded, cut to 0..1, rounded."""
    return _whole_numbers(image, exposure, 255.0).astype(np.uint8)


def to_words(image: Float[Array, "h w 3"], *, exposure: float = 0.0) -> UInt16[np.ndarray, "h w 3"]:
    """As `to_bytes`, with 16 bits per channel."""
    return _whole_numbers(image, exposure, 65535.0).astype(np.uint16)


def _whole_numbers(image: Float[Array, "h w 3"], exposure: float, white: float) -> Float[np.ndarray, "h w 3"]:
    shown = device_array(image)
    factors = (device_array(factor, shown.dtype) for factor in (2.0**exposure, white))
    return np.asarray(_displayed(shown, *factors))


@jit
def _displayed(
    image: Float[Array, "h w 3"], factor: Float[Array, ""], white: Float[Array, ""]
) -> Float[Array, "h w 3"]:
    # A screen has a darkest and a brightest value; the linear picture keeps what is cut here.
    return jnp.round(white * jnp.clip(encode_srgb(factor * image), 0.0, 1.0))
