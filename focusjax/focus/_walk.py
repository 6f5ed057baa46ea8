"""Bounded least squares for given sides, by `BoundedLevenbergMarquardt`.

Blur is linear in (E, E n) for aperture radius E and plane n, so a step in these is tried, too, where both are
free: inside the bounds it ends at the optimum for the sides.

What the wishes leave open goes no farther than it must: of all steps that are equally good the one is taken
that changes the picture least, each parameter measured in pixels (`scales`).

Parameters that no error follows by as much as `UNDETERMINED_PX` over their whole range stay where they are:
what slope they have is rounding, once the wishes that would move them are met.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._entries import with_entries
from focusjax.focus._bounds import Box
from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._objective import Objective
from focusjax.focus._parameters import FOCUS, RADIUS, SWING, TILT

PLANE = (FOCUS, TILT, SWING)
"""Parameters that the radius multiplies."""


class Walk(eqx.Module):
    """Where a walk has ended: free parameters, whether it came to rest, and its steps."""

    value: Float[Array, "k"]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]


def walk(
    objective: Objective, side: Float[Array, "n"], first: Float[Array, "k"], box: Box, max_steps: int
) -> Walk:
    """The best parameters in the box for given sides, downhill from `first`."""
    import optimistix as optx

    from focusjax.solvers import BoundedLevenbergMarquardt

    found = optx.least_squares(
        _residuals,
        BoundedLevenbergMarquardt(),
        first,
        args=(objective, side, box),
        options={
            "lower": box.lower,
            "upper": box.upper,
            "scale": objective.scale,
            "linearise": _linearised,
            "rounding": _rounding,
            "paths": _paths,
        },
        max_steps=max_steps,
        throw=False,
    )
    steps = jnp.asarray(found.stats["num_steps"])
    return Walk(found.value, found.result == optx.RESULTS.successful, steps)


def _residuals(value: Float[Array, "k"], args: Any) -> Float[Array, "m"]:
    """Errors and expectations, of which `Objective.cost` is the sum of squares."""
    objective, side, _ = args
    return _rows(objective, value, objective.errors(value, side))


def _rows(objective: Objective, value: Float[Array, "k"], error: Float[Array, "n"]) -> Float[Array, "m"]:
    """The residuals at `value`, where the errors are these."""
    priors = jnp.sqrt(objective.prior_share) * objective.priors(value)
    return jnp.concatenate([jnp.sqrt(objective.share) * error, priors])


def _linearised(fn: Any, value: Float[Array, "k"], args: Any) -> tuple[Float[Array, "m"], Any]:
    """Residuals and slopes over the longest column, in pixels; 0 in columns that hardly matter."""
    import lineax as lx

    objective, side, box = args
    error, slopes = objective.slopes(value, side)
    root, prior_root = jnp.sqrt(objective.share), jnp.sqrt(objective.prior_share)
    effect = jnp.linalg.norm(jnp.where(objective.counted[:, None], slopes, 0.0), axis=0)
    idle = (effect * (box.upper - box.lower) < UNDETERMINED_PX) & (objective.priors.inverse == 0)
    jacobian = jnp.concatenate([root[:, None] * slopes, prior_root * jnp.diag(objective.priors.inverse)])
    jacobian = jnp.where(idle[None], 0.0, jacobian)
    size = jnp.sqrt(jnp.max(jnp.sum((jacobian / objective.scale[None]) ** 2, axis=0)))
    over = 1.0 / jnp.where(size > 0.0, size, 1.0)
    return over * _rows(objective, value, error), lx.MatrixLinearOperator(over * jacobian)


def _rounding(fn: Any, value: Float[Array, "k"], args: Any) -> Float[Array, "m"]:
    """What of the change of each residual can be rounding."""
    objective, _, _ = args
    rows = 4.0 * jnp.sqrt(objective.share) * objective.noise(value)
    of_priors = 1e3 * jnp.finfo(value.dtype).eps * jnp.sqrt(objective.prior_share)
    return jnp.concatenate([rows, jnp.broadcast_to(of_priors, value.shape)])


def _paths(
    value: Float[Array, "k"], step: Any, lower: Float[Array, "k"], upper: Float[Array, "k"], args: Any
) -> tuple[Float[Array, "k"], ...]:
    """A step in (E, E n), and one in (E, n): the first may be cut off at a bound so that it does not help."""
    columns = args[0].columns
    straight = value + step.change
    if not has_products(columns):
        return (straight,)
    return with_products(value, step.change, Box(lower, upper), columns), straight


def has_products(columns: tuple[int, ...]) -> bool:
    """Whether the radius is free, and some of what it multiplies in the blur."""
    return RADIUS in columns and bool(np.isin(columns, PLANE).any())


def with_products(
    value: Float[Array, "k"], change: Float[Array, "k"], box: Box, columns: tuple[int, ...]
) -> Float[Array, "k"]:
    """`value` after a change that is linear in (E, E n) and begins as `change` does, with E inside the box.

    Blur is linear in these, so that all of the step is as good as its beginning.
    """
    moved = value + change
    if not has_products(columns):
        return moved
    products = np.isin(columns, PLANE)
    which = columns.index(RADIUS)
    wider = jnp.clip(moved[which], box.lower[which], box.upper[which])
    carried = (value[which] * moved + value * change[which]) / wider
    return with_entries(jnp.where(products, carried, moved), (which,), (wider,))
