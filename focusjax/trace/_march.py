"""The walks of many rays at once, by the means of the machine that runs them.

Most rays meet something in their first step, a few pass under a silhouette for dozens. On a CPU all rays take
the first step together; those that go on are compacted into parts that fit the cache, each of which is walked
until its last ray has ended. Elsewhere every ray is a lane of one loop.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, UInt

from focusjax.trace._prefix import compacted
from focusjax.trace._walk import Passing, Path, Volume, take_step

_FIRST_STEPS = 2
_PART = 8192
"""Rays walked together after the first steps, few enough for all about them to stay in the cache."""


def first_hits(volume: Volume, paths: Path, chance: UInt[Array, " n"] | None = None) -> Int[Array, " n"]:
    """As `first_hit`, for the n rays of `paths`."""
    passing = None if volume.opacity is None or chance is None else Passing(jnp.zeros_like(chance), chance)
    return jax.lax.platform_dependent(volume, paths, passing, cpu=_compacting, default=_in_lanes)


def _in_lanes(volume: Volume, paths: Path, passing: Passing | None) -> Int[Array, " n"]:
    """All rays in one loop."""
    return _walked(volume, paths, passing, jnp.int32(0), None)[0]


def _compacting(volume: Volume, paths: Path, passing: Passing | None) -> Int[Array, " n"]:
    """The first steps together, the others in parts."""
    count = paths.steps.shape[0]
    # A loop, as XLA would otherwise work out anew in it what paths are made of.
    hits, passing = _walked(volume, paths, passing, jnp.int32(0), _FIRST_STEPS)
    lanes, going = compacted((hits < 0) & (paths.steps > _FIRST_STEPS))
    lanes = jnp.pad(lanes, (0, _PART))

    def part(number: Int[Array, ""], hits: Int[Array, " n"]) -> Int[Array, " n"]:
        mine = jax.lax.dynamic_slice(lanes, (number * _PART,), (_PART,))
        path, known = jax.tree.map(lambda a: a.at[mine].get(mode="promise_in_bounds"), (paths, passing))
        there = number * _PART + jnp.arange(_PART, dtype=jnp.int32) < going
        path = dataclasses.replace(path, steps=jnp.where(there, path.steps, 0))
        found, _ = _walked(volume, path, known, jnp.int32(_FIRST_STEPS), None)
        return hits.at[jnp.where(there, mine, count)].set(found, mode="drop")

    return jax.lax.fori_loop(jnp.int32(0), (going + _PART - 1) // _PART, part, hits)


_State = tuple[Int[Array, ""], Int[Array, " n"], Passing | None]


def _walked(
    volume: Volume, paths: Path, passing: Passing | None, begin: Int[Array, ""], end: int | None
) -> tuple[Int[Array, " n"], Passing | None]:
    """Where rays hit in steps from `begin` until `end`, or until all have ended, and what they then know."""

    def going(hits: Int[Array, " n"], step: Int[Array, ""]) -> Array:
        return (hits < 0) & (step < paths.steps)

    def unfinished(state: _State) -> Array:
        step, hits, _ = state
        # As a number: XLA for CPU writes out `any` of a long array ten times as long.
        more = jnp.where(hits < 0, paths.steps, 0).max() > step
        return more if end is None else more & (step < end)

    def advance(state: _State) -> _State:
        step, hits, known = state
        found, then = jax.vmap(lambda path, k: take_step(volume, path, step, k))(paths, known)
        on = going(hits, step)
        hits, known = jax.tree.map(lambda new, old: jnp.where(on, new, old), (found, then), (hits, known))
        return step + 1, hits, known

    nowhere = jnp.full(paths.steps.shape, -1, dtype=jnp.int32)
    return jax.lax.while_loop(unfinished, advance, (begin, nowhere, passing))[1:]
