"""Bounded least squares for given sides: Gauss-Newton steps with as little damping as will do.

Parameters at a bound that the gradient pushes against stay there during a step; the others take the
step and are cut off at their bounds. With enough damping that is a step of projected gradient descent, so
it helps in the end (Bertsekas 1982). Blur is linear in (E, E n) for aperture radius E and plane n, so a
step in these is tried first where both are free: inside the bounds it ends at the optimum for the sides.

What the wishes leave open goes no farther than it must: of all steps that are equally good the one is taken
that changes the picture least, each parameter measured in pixels (`scales`).

Parameters that no error follows by as much as `UNDETERMINED_PX` over their whole range stay where they are:
what slope they have is rounding, once the wishes that would move them are met.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._objective import Objective
from focusjax.focus._parameters import FOCUS, RADIUS, SWING, TILT

_GENTLE = 1e-3
"""Damping after a step that did not help."""

_HOPELESS = 1e8
"""Damping at which no step is left to take."""


class Walk(eqx.Module):
    """Where a walk is.

    Attributes:
        value: free parameters.
        cost: see `Objective.cost`.
        damping: of the next step, relative to the largest slope squared.
        product: whether the next step is one in (E, E n).
        settled: whether the last step was within rounding.
        steps: steps taken.
    """

    value: Float[Array, "k"]
    cost: Float[Array, ""]
    damping: Float[Array, ""]
    product: Bool[Array, ""]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]


def walk(
    objective: Objective,
    side: Float[Array, "n"],
    first: Float[Array, "k"],
    box: Box,
    max_steps: int | Int[Array, ""],
) -> Walk:
    """The best parameters in the box for given sides, downhill from `first`."""
    rounding = 1e3 * jnp.finfo(first.dtype).eps
    least = jnp.asarray(rounding**2, first.dtype)

    def more(state: Walk) -> Bool[Array, ""]:
        return ~state.settled & (state.steps < max_steps)

    def step(state: Walk) -> Walk:
        error, slopes = objective.slopes(state.value, side)
        moved = _moved(objective, state, error, slopes, box)
        cost = objective.cost(moved, side)
        change = jnp.abs(objective.excess(moved, side) - objective.excess(state.value, side))
        inside_noise = jnp.all(~objective.counted | (change <= 4.0 * objective.noise(moved)))
        inside_noise &= jnp.all(jnp.abs((moved - state.value) * objective.priors.inverse) <= rounding)
        better = cost < state.cost
        calmer = jnp.maximum(state.damping * 16.0, _GENTLE)
        # A step in (E, E n) may be cut off at a bound so that it does not help; one in (E, n) then will.
        damping = jnp.where(state.product, state.damping, calmer)
        damping = jnp.where(better, jnp.maximum(state.damping / 32.0, least), damping)
        return Walk(
            value=jnp.where(better, moved, state.value),
            cost=jnp.where(better, cost, state.cost),
            damping=damping,
            product=better & ~inside_noise,
            settled=~state.product & (inside_noise | (damping > _HOPELESS)),
            steps=state.steps + 1,
        )

    start = Walk(
        value=first,
        cost=objective.cost(first, side),
        damping=least,
        product=jnp.array(True),
        settled=jnp.array(False),
        steps=jnp.array(0),
    )
    return jax.lax.while_loop(more, step, start)


def _moved(
    objective: Objective, state: Walk, error: Float[Array, "n"], slopes: Float[Array, "n k"], box: Box
) -> Float[Array, "k"]:
    """The damped Gauss-Newton step from `state`, inside the box."""
    value, columns = state.value, objective.columns
    root = jnp.sqrt(objective.share)
    prior_root = jnp.sqrt(objective.prior_share)
    jacobian = jnp.concatenate([root[:, None] * slopes, prior_root * jnp.diag(objective.priors.inverse)])
    residual = jnp.concatenate([root * error, prior_root * objective.priors(value)])
    gradient = residual @ jacobian
    stuck = ((value <= box.lower) & (gradient > 0)) | ((value >= box.upper) & (gradient < 0))
    effect = jnp.linalg.norm(jnp.where(objective.counted[:, None], slopes, 0.0), axis=0)
    idle = (effect * (box.upper - box.lower) < UNDETERMINED_PX) & (objective.priors.inverse == 0)
    moves = ~stuck & ~idle
    change = _damped(jnp.where(moves[None], jacobian, 0.0), residual, objective.scale, state.damping)
    moved = jnp.where(state.product, with_products(value, change, box, columns), value + change)
    return box.inside(jnp.where(moves, moved, value))


def with_products(
    value: Float[Array, "k"], change: Float[Array, "k"], box: Box, columns: tuple[int, ...]
) -> Float[Array, "k"]:
    """`value` after a change that is linear in (E, E n) and begins as `change` does, with E inside the box.

    Blur is linear in these, so that all of the step is as good as its beginning.
    """
    moved = value + change
    products = np.isin(columns, (FOCUS, TILT, SWING)) & (RADIUS in columns)
    if not products.any():
        return moved
    which = columns.index(RADIUS)
    wider = jnp.clip(moved[which], box.lower[which], box.upper[which])
    carried = (value[which] * moved + value * change[which]) / wider
    return jnp.where(products, carried, moved).at[which].set(wider)


def _damped(
    jacobian: Float[Array, "m k"],
    residual: Float[Array, "m"],
    scale: Float[Array, "k"],
    damping: Float[Array, ""],
) -> Float[Array, "k"]:
    """The least-squares change; of equally good ones the least, times `scale`; 0 for columns of zeros.

    By QR, and not by the normal equations: damping as small as rounding squared then still separates
    what is weakly determined from what is undetermined.
    """
    scaled = jacobian / scale[None]
    size = jnp.max(jnp.sum(scaled**2, axis=0))
    root = jnp.sqrt(damping * jnp.where(size > 0.0, size, 1.0))
    rows = jnp.concatenate([scaled, root * jnp.eye(scale.size, dtype=scale.dtype)])
    right = jnp.concatenate([residual, jnp.zeros_like(scale)])
    triangle = jnp.linalg.qr(jnp.concatenate([rows, right[:, None]], axis=1), mode="r")[: scale.size]
    return -jax.scipy.linalg.solve_triangular(triangle[:, :-1], triangle[:, -1]) / scale
