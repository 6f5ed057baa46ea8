"""Work on long columns, some rows at a time."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from focusjax._at_once import at_once


def in_parts(
    function: Callable[[tuple[Array, ...]], tuple[Array, ...]], columns: tuple[Array, ...]
) -> tuple[Array, ...]:
    """A function of columns [n] to columns, applied to some rows at a time.

    So what it needs meanwhile is that of few rows. It is a loop, as XLA for CPU would otherwise work out anew
    in every step after what it returns; see `focusjax.trace._starts`.
    """
    count = columns[0].shape[0]
    parts = -(-count // at_once(cpu=1 << 13, gpu=1 << 24))
    size = -(-count // parts)
    rows = tuple(jnp.pad(a, (0, parts * size - count), mode="edge").reshape(parts, size) for a in columns)
    return tuple(a.reshape(-1)[:count] for a in jax.lax.map(function, rows))
