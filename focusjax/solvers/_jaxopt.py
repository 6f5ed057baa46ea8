"""The only place that knows jaxopt: its bounded quasi-Newton method, as a solver of Optimistix.

jaxopt is no longer maintained, and says so when imported. It serves to check the other solver. It is imported
when it is used.
"""

import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree

from focusjax.solvers._bounded import bounds_of, half_squares


class JaxoptLBFGSB(optx.AbstractLeastSquaresSolver):
    """jaxopt's L-BFGS-B (Byrd et al. 1995), for `optimistix.least_squares`.

    It sees the cost and its gradient, and takes more steps than a solver that sees residuals.

    Attributes:
        rtol: the solve ends when no element of the projected gradient is more than atol + rtol |y|.
        atol: the same, in units of the cost by those of y.
        norm: of y in that.

    The `options` of `least_squares` may have `lower` and `upper`, bounds: one number, or of the structure of
    y with -inf or inf where there is none.

    Example:
        >>> import optimistix as optx
        >>> from focusjax.solvers import JaxoptLBFGSB
        >>> found = optx.least_squares(
        ...     lambda y, _: y - 3.0, JaxoptLBFGSB(), jnp.zeros(2), options={"upper": jnp.array([2.0, 9.0])}
        ... )
        >>> found.value.round(4).tolist()
        [2.0, 3.0]
    """

    rtol: float = 0.0
    atol: float = 1e-4
    norm: Callable[[PyTree], Float[Array, ""]] = optx.max_norm

    def init(
        self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any
    ) -> Any:
        """What jaxopt keeps between steps."""
        bounds = bounds_of(options, y)
        with jax.numpy_rank_promotion("allow"):
            state = self._inner(fn).init_state(jax.tree.map(jnp.clip, y, *bounds), bounds, args)
        return jax.tree.map(jnp.asarray, state)

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> tuple[Any, Any, Any]:
        """One step of jaxopt."""
        bounds = bounds_of(options, y)
        # jaxopt broadcasts ranks in ways that a strict JAX configuration refuses.
        with jax.numpy_rank_promotion("allow"):
            moved, new = self._inner(fn).update(jax.tree.map(jnp.clip, y, *bounds), state, bounds, args)
        new = jax.tree.map(lambda leaf, like: jnp.asarray(leaf, like.dtype), new, state)
        return moved, new, fn(moved, args)[1]

    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Whether the projected gradient is small."""
        return state.error <= self.atol + self.rtol * self.norm(y), optx.RESULTS.successful

    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: Any, tags: Any, result: Any
    ) -> tuple[Any, Any, dict[str, Any]]:
        """Nothing is left to do."""
        return y, aux, {}

    def _inner(self, fn: Any) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            import jaxopt

        def cost(y: Any, args: Any) -> Array:
            return half_squares(fn(y, args)[0])

        return jaxopt.LBFGSB(fun=cost, implicit_diff=False)
