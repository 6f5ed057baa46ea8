"""How the solution of all frames follows the wishes, by the implicit function theorem.

At the solution the gradient g(x, theta) of the cost vanishes along every parameter that no bound pins, so
H dx = -dg: with H the cost's second derivative, and dg the change of g with wishes, bounds and all else. H
is eliminated in time linear in the frames. The sides that wishes have chosen and the active bounds are held.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax.focus._joint import Joint

_OPEN_RIDGE = 1e3
"""Rounding steps of H's largest entry that are added for what the wishes leave open, so that it stays."""


@eqx.filter_custom_jvp
def following(
    joint: Joint,
    pixels: Float[Array, "t k"],
    side: Float[Array, "t n"],
    at_lower: Bool[Array, "t k"],
    at_upper: Bool[Array, "t k"],
    kept: Float[Array, "t k"],
    open_: Bool[Array, "k"],
) -> Float[Array, "t k"]:
    """`pixels`, with the derivative of the solution with respect to all that `joint` holds.

    Args:
        joint: the problem, with derivatives.
        pixels: its solution, without.
        side: the sides that points are on there.
        at_lower: parameters that a lower bound keeps from a better value; they follow the bound.
        at_upper: the same for upper bounds.
        kept: values of 0 whose derivatives are those of what the wishes leave open.
        open_: parameters that have a part in what the wishes leave open.
    """
    return pixels


@following.def_jvp
def _following_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    return eqx.filter_jvp(_followed, primals, tangents)


def _followed(
    joint: Joint,
    pixels: Float[Array, "t k"],
    side: Float[Array, "t n"],
    at_lower: Bool[Array, "t k"],
    at_upper: Bool[Array, "t k"],
    kept: Float[Array, "t k"],
    open_: Bool[Array, "k"],
) -> Float[Array, "t k"]:
    """`following`, with a derivative that JAX finds."""
    from focusjax.solvers import solve_hessian

    pinned = at_lower | at_upper
    here = jnp.where(at_lower, joint.lower, jnp.where(at_upper, joint.upper, pixels))
    start = pixels + (here - jax.lax.stop_gradient(here)) + kept
    slope = joint.linearised(start, side).gradient
    off = jnp.where(pinned, 0.0, slope - jax.lax.stop_gradient(slope))
    fixed = jax.lax.stop_gradient(joint)
    own = fixed.curvature(pixels, side)
    stiffest = jnp.max(jnp.abs(own)) + jnp.max(6.0 * fixed.bend**2 + 2.0 * fixed.pace**2)
    ridge = jnp.where(open_, _OPEN_RIDGE * jnp.finfo(own.dtype).eps * stiffest, 0.0)
    own = own + jnp.diag(ridge)[None]
    return start - solve_hessian(own, fixed.bend, fixed.pace, ~pinned, off)
