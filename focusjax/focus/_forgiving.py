"""Optimistix's Gauss-Newton solvers, which go on where only rounding decides whether a step helps.

Optimistix takes long to import, so this module is imported by functions that solve.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool

# Rounding steps by which a computed cost may be off.
_NOISE = 8.0


class _Forgiving(optx.AbstractSearch):
    """A trust region that also accepts steps whose effect is lost in rounding.

    At the optimum rounding decides whether the next step seems to help. One that is refused is no sign of
    having arrived, so without this, solvers that start there may never stop.
    """

    inner: optx.ClassicalTrustRegion

    def init(self, y: Array, f_info_struct: Any) -> Any:
        return self.inner.init(y, f_info_struct)

    def step(
        self,
        first_step: Bool[Array, ""],
        y: Array,
        y_eval: Array,
        f_info: Any,
        f_eval_info: Any,
        state: Any,
    ) -> tuple[Array, Bool[Array, ""], optx.RESULTS, Any]:
        size, accept, result, state = self.inner.step(first_step, y, y_eval, f_info, f_eval_info, state)
        cost = f_info.as_min()
        noise = _NOISE * jnp.finfo(cost.dtype).eps * cost
        lost = jnp.abs(self.inner.predict_reduction(y_eval - y, f_info)) <= noise
        return size, accept | (lost & (f_eval_info.as_min() - cost <= noise)), result, state


def forgiving(solver: Any) -> Any:
    """The same Gauss-Newton solver with that search."""
    return eqx.tree_at(lambda each: each.search, solver, _Forgiving(solver.search))
