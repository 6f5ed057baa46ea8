"""The only place that knows jaxopt: bounded minimisation by projected quasi-Newton steps.

jaxopt is no longer maintained, and says so when imported. It serves as a second method, to check the
first one with, because it has bounded solvers that run compiled. Who does not ask for
it does not wait for its import.
"""

import warnings
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree


def least_squares_in_box(
    residuals: Callable[[Float[Array, "p"], PyTree], Float[Array, "n"]],
    start: Float[Array, "p"],
    args: PyTree,
    lower: Float[Array, "p"],
    upper: Float[Array, "p"],
    *,
    tolerance: float,
    max_steps: int,
) -> tuple[Float[Array, "p"], Int[Array, ""], Bool[Array, ""]]:
    """Minimises half the sum of squared residuals over a box by L-BFGS-B (Byrd et al. 1995).

    Args:
        residuals: function of the variables and `args`.
        start: variables to begin with, in the box.
        args: passed on to `residuals`.
        lower: lower bounds.
        upper: upper bounds.
        tolerance: how small the projected gradient's largest entry is to get.
        max_steps: steps allowed.

    Returns:
        The variables, the number of steps, and whether the tolerance was reached.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import jaxopt

    def cost(variables: Float[Array, "p"], passed: PyTree) -> Float[Array, ""]:
        return 0.5 * jnp.sum(residuals(variables, passed) ** 2)

    solver = jaxopt.LBFGSB(fun=cost, maxiter=max_steps, tol=tolerance, implicit_diff=False)
    # jaxopt broadcasts ranks in ways that a strict JAX configuration refuses.
    with jax.numpy_rank_promotion("allow"):
        variables, state = solver.run(start, (lower, upper), args)
    return variables, state.iter_num, state.error <= tolerance
