"""How many photons arrive where few are expected."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

FEW = 32.0
"""Photons up to which their number is Poisson's; that of more is near enough to normal (skewness 0.18)."""
_MOST = 96
"""Photons that FEW expected ones are never: more has a probability of 1e-19."""


def few_photons(key: PRNGKeyArray, expected: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Numbers by Poisson's law, for up to `FEW` expected photons: by its distribution function.

    The derivative is that of e + sqrt(e) z for the z = (n - e) / sqrt(e) that were drawn.
    """
    fixed = jax.lax.stop_gradient(jnp.clip(expected, 0.0, FEW))
    level = jax.random.uniform(key, expected.shape, expected.dtype)

    def more(number: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        chance, total, found = state
        found = found + (level > total)
        chance = chance * fixed / (number + 1.0)
        return chance, total + chance, found

    none = jnp.exp(-fixed)
    *_, found = jax.lax.fori_loop(0, _MOST, more, (none, none, jnp.zeros_like(fixed)))
    some = fixed > 0.0
    drawn = jnp.where(some, (found - fixed) / jnp.sqrt(jnp.where(some, fixed, 1.0)), 0.0)
    root = jnp.where(some, jnp.sqrt(jnp.where(some, expected, 1.0)), 0.0)
    return expected + root * drawn
