"""Derivatives forwards, in reverse, and by central differences, which have to be the same."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

STEP = 1e-5
_FEW = 8
"""Numbers of which slopes are found at every place where there are differences."""


def check_gradients(function: Callable, *arguments: object, rtol: float = 1e-6) -> np.ndarray:
    """Assert that the Jacobian of `function` with respect to every array in `arguments` is right.

    Differences are central, of `STEP` times the size of each number (at least `STEP` itself), so that
    their own error is about STEP^2. A `function` of a module is compiled once for all arguments
    of the same shapes, and so is an `eqx.Module` for all arrays that it holds.

    Returns:
        The Jacobian, of all outputs by all numbers in `arguments`.
    """
    forward, reverse, differences = _jacobians(function, arguments)
    assert np.isfinite(forward).all()
    scale = float(np.abs(forward).max())
    np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(forward, differences, rtol=0, atol=rtol * scale)
    return np.asarray(forward)


def central_differences(answer: Callable, flat: Float[Array, " n"]) -> Float[Array, "n *m"]:
    """The slopes of answers of any shape by each of n numbers, by central differences."""
    steps, moved = _moved(flat)
    return _divided(steps, jax.vmap(answer)(moved))


def _moved(flat: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, "p n"]]:
    """The step of each number, and the places with one added, then those with one taken away."""
    steps = STEP * jnp.maximum(jnp.abs(flat), 1.0)
    return steps, flat[None] + jnp.concatenate([jnp.diag(steps), -jnp.diag(steps)])


def _divided(steps: Float[Array, " n"], answers: Float[Array, "p *m"]) -> Float[Array, "n *m"]:
    ahead, back = jnp.split(answers, 2)
    return (ahead - back) / (2 * steps.reshape(-1, *[1] * (ahead.ndim - 1)))


@eqx.filter_jit
def _jacobians(function: Callable, arguments: tuple) -> tuple[Float[Array, "m n"], ...]:
    flat, restore = ravel_pytree(arguments)

    def answer(flat):
        return ravel_pytree(function(*restore(flat)))[0]

    def slopes(flat):
        # Linearised once for both directions, as compiling takes most of the time.
        here, forwards = jax.linearize(answer, flat)
        backwards = jax.linear_transpose(forwards, flat)
        forward = jax.vmap(forwards, out_axes=1)(jnp.eye(flat.size, dtype=flat.dtype))
        (reverse,) = jax.vmap(backwards)(jnp.eye(here.size, dtype=here.dtype))
        return here, forward, reverse

    steps, moved = _moved(flat)
    if flat.size <= _FEW:
        # One program for all places: few slopes are found sooner than another is compiled.
        here, forward, reverse = jax.vmap(slopes)(jnp.concatenate([flat[None], moved]))
        (forward, reverse), answers = (forward[0], reverse[0]), here[1:]
    else:
        (_, forward, reverse), answers = slopes(flat), jax.vmap(answer)(moved)
    return forward, reverse, _divided(steps, answers).T
