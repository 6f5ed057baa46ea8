"""Small programs that run a few times: compiled in a third of the time, with little optimisation."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
from jax.core import Tracer

_Function = TypeVar("_Function", bound=Callable[..., Any])

_OPTIONS = {
    "xla_backend_optimization_level": 0,
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_parallel_codegen_split_count": 1,
}
"""Of XLA: what takes most of the time to compile, and gains a program on little data next to nothing."""

_MUCH = 1 << 14
"""Numbers in its arguments from which on a program is compiled as always."""


def jit_in_haste(function: _Function) -> _Function:
    """`equinox.filter_jit` of a function; on a processor and for few numbers it is compiled in haste.

    JAX takes such options for a whole program only: inside another one, as in `jax.grad` or a larger `jit`,
    the function is compiled like that one. XLA changes its options from version to version: one that does not
    know these compiles as always.
    """
    options: dict[str, Any] = {"compiler_options": _OPTIONS}
    plain, hasty = eqx.filter_jit(function), eqx.filter_jit(function, **options)

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        leaves = [leaf for leaf in jax.tree.leaves(arguments) if eqx.is_array(leaf)]
        inside = any(isinstance(leaf, Tracer) for leaf in leaves)
        if inside or sum(leaf.size for leaf in leaves) > _MUCH or not _options_are_known():
            return plain(*arguments)
        return hasty(*arguments)

    return call  # pyright: ignore[reportReturnType]


@functools.cache
def _options_are_known() -> bool:
    """Whether programs run on a processor, by a version of XLA that knows all options."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: 0, compiler_options=_OPTIONS)()
    except jax.errors.JaxRuntimeError:
        return False
    return True
