"""Sums, running extremes and stream compaction in the forms that XLA compiles well."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

_ROW, _FEW = 16, 256


def prefix_sums(counts: Int[Array, " n"]) -> tuple[Int[Array, " n"], Int[Array, ""]]:
    """Sums of all counts before each, and of all.

    In rows and then over rows: XLA adds up one long array in many passes, which take long to compile.
    """
    length = counts.shape[0]
    counts = counts.astype(jnp.int32)
    if length <= _FEW:
        return _sums_before(counts), counts.sum(dtype=jnp.int32)
    rows = jnp.pad(counts, (0, -length % _ROW)).reshape(-1, _ROW)
    above, whole = prefix_sums(rows.sum(axis=1, dtype=jnp.int32))
    return (above[:, None] + _sums_before(rows)).reshape(-1)[:length], whole


def compacted(kept: Bool[Array, " n"]) -> tuple[Int[Array, " n"], Int[Array, ""]]:
    """Positions that are kept, in order, at the front; and how many they are."""
    before, total = prefix_sums(kept.astype(jnp.int32))
    numbers = jnp.arange(kept.shape[0], dtype=jnp.int32)
    place = jnp.where(kept, before, kept.shape[0])
    return jnp.zeros_like(numbers).at[place].set(numbers, mode="drop"), total


def running_max(values: Int[Array, " n"]) -> Int[Array, " n"]:
    """Largest value up to each place, of values at least 0; in rows, as prefix sums are."""
    length = values.shape[0]
    if length <= _FEW:
        return _largest_upto(values)
    rows = jnp.pad(values, (0, -length % _ROW)).reshape(-1, _ROW)
    above = running_max(rows.max(axis=1))
    above = jnp.concatenate([jnp.zeros(1, dtype=values.dtype), above[:-1]])
    return jnp.maximum(above[:, None], _largest_upto(rows)).reshape(-1)[:length]


def _sums_before(counts: Int[Array, "*m n"]) -> Int[Array, "*m n"]:
    """Of few counts, each added up for itself: quicker to compile, and to do, than one after the other."""
    return jnp.where(_earlier(counts), counts[..., None, :], 0).sum(axis=-1, dtype=jnp.int32)


def _largest_upto(values: Int[Array, "*m n"]) -> Int[Array, "*m n"]:
    return jnp.maximum(values, jnp.where(_earlier(values), values[..., None, :], 0).max(axis=-1, initial=0))


def _earlier(values: Int[Array, "*m n"]) -> Bool[Array, "*#m n n"]:
    """Whether the place of the last axis comes before that of the one before it."""
    place = jnp.arange(values.shape[-1], dtype=jnp.int32)
    return jnp.expand_dims(place[:, None] > place[None], range(values.ndim - 1))
