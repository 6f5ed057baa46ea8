"""Work on long columns, some rows at a time.

XLA for CPU works what several programs read out anew in each of them, and what it is made of: film points,
looked up in a table of samples, would be looked up again, and rays traced through glass again, in every step
after. Nothing but a loop keeps it from that. So such work is done in a loop over some thousand rows at a
time, whose numbers stay in the cache of a processor, and in plain columns.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from focusjax._at_once import at_once


def in_parts(
    function: Callable[[tuple[Array, ...]], tuple[Array, ...]],
    columns: tuple[Array, ...],
    *,
    cpu: int = 1 << 13,
) -> tuple[Array, ...]:
    """A function of columns [n] to columns, applied to some rows at a time: `cpu` on a processor."""
    count = columns[0].shape[0]
    parts = -(-count // at_once(cpu=cpu, gpu=1 << 24))
    size = -(-count // parts)
    # The last row is repeated to fill them.
    rows = tuple(jnp.pad(a, (0, parts * size - count), mode="edge").reshape(parts, size) for a in columns)
    return tuple(a.reshape(-1)[:count] for a in jax.lax.map(function, rows))
