"""Prefix sums and stream compaction of long arrays."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

_ROW = 128


def prefix_sums(counts: Int[Array, " n"]) -> tuple[Int[Array, " n"], Int[Array, ""]]:
    """Sums of all counts before each, and of all.

    In rows and then over rows: XLA adds up one long array in many passes.
    """
    length = counts.shape[0]
    rows = jnp.pad(counts, (0, -length % _ROW)).reshape(-1, _ROW)
    total = rows.sum(axis=1, dtype=jnp.int32)
    if total.shape[0] > 4 * _ROW:
        above, whole = prefix_sums(total)
    else:
        ends = jnp.cumsum(total, dtype=jnp.int32)
        above, whole = ends - total, ends[-1] if total.shape[0] else jnp.int32(0)
    inside = jnp.cumsum(rows, axis=1, dtype=jnp.int32) - rows
    return (above[:, None] + inside).reshape(-1)[:length], whole


def compacted(kept: Bool[Array, " n"]) -> tuple[Int[Array, " n"], Int[Array, ""]]:
    """Positions that are kept, in order, at the front; and how many they are."""
    before, total = prefix_sums(kept.astype(jnp.int32))
    numbers = jnp.arange(kept.shape[0], dtype=jnp.int32)
    place = jnp.where(kept, before, kept.shape[0])
    return jnp.zeros_like(numbers).at[place].set(numbers, mode="drop"), total
