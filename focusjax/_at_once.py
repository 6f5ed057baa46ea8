"""How much work is done together, by what does it.

A processor is quickest with as many rows as stay in its cache. A GPU does thousands of rows in the time of
one, and between any two of its programs it waits for the processor.
"""

from collections.abc import Callable
from typing import Any

import jax


def at_once(*, cpu: int, gpu: int) -> int:
    """Rows of work that JAX's default backend does together: those for processors, or for all else."""
    return cpu if _on_processor() else gpu


def one_by_one(function: Callable[..., Any], rows: Any) -> Any:
    """`function` of each of few `rows`, for the memory or to compile quickly; all together on a GPU."""
    return jax.lax.map(function, rows) if _on_processor() else jax.vmap(function)(rows)


def _on_processor() -> bool:
    return jax.default_backend() == "cpu"
