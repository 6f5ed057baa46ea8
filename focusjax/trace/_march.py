"""The walks of many rays at once, by the means of the machine that runs them.

Most rays meet something in their first step, a few pass under a silhouette for dozens. On a CPU all rays take
the first step together; those that go on are compacted into parts that fit the cache, each of which is walked
until its last ray has ended. On an NVIDIA GPU a kernel walks few rays each to their end, which stay in its
registers. Elsewhere every ray is a lane of one loop, whose every step goes through memory.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, UInt

from focusjax._whole import taken
from focusjax.trace._sums import compacted
from focusjax.trace._walk import Passing, Path, Read, Volume, gathered, take_step

_FIRST_STEPS = 2
_PART = 8192
"""Rays walked together after the first steps, few enough for all about them to stay in the cache."""
_OF_KERNEL, _WARPS = 128, 2
"""Rays that a kernel walks, and how many warps of 32 it has for them."""


def first_hits(volume: Volume, paths: Path, chance: UInt[Array, " n"] | None = None) -> Int[Array, " n"]:
    """As `first_hit`, for the n rays of `paths`."""
    passing = None if volume.opacity is None or chance is None else Passing(jnp.zeros_like(chance), chance)
    ways: dict[str, Callable] = {"cpu": _compacting}
    if jax.default_backend() == "gpu":
        # Not elsewhere, as all ways are traced before one is chosen.
        ways["cuda"] = _in_kernels
    return jax.lax.platform_dependent(volume, paths, passing, **ways, default=_in_lanes)


def _in_lanes(volume: Volume, paths: Path, passing: Passing | None) -> Int[Array, " n"]:
    """All rays in one loop."""
    return _walked(volume, paths, passing, jnp.int32(0), None)[0]


def _compacting(volume: Volume, paths: Path, passing: Passing | None) -> Int[Array, " n"]:
    """The first steps together, the others in parts; few rays as one part."""
    count = paths.steps.shape[0]
    if count <= _PART:
        return _in_lanes(volume, paths, passing)
    # A loop, as XLA would otherwise work out anew in it what paths are made of.
    hits, passing = _walked(volume, paths, passing, jnp.int32(0), jnp.int32(_FIRST_STEPS))
    lanes, going = compacted((hits < 0) & (paths.steps > _FIRST_STEPS))
    lanes = jnp.pad(lanes, (0, _PART))

    def part(number: Int[Array, ""], hits: Int[Array, " n"]) -> Int[Array, " n"]:
        mine = jax.lax.dynamic_slice(lanes, (number * _PART,), (_PART,))
        path, known = jax.tree.map(lambda a: taken(a, mine), (paths, passing))
        there = number * _PART + jnp.arange(_PART, dtype=jnp.int32) < going
        path = dataclasses.replace(path, steps=jnp.where(there, path.steps, 0))
        # To the end of the longest: to look after each step who has ended takes longer than it saves.
        found, _ = _walked(volume, path, known, jnp.int32(_FIRST_STEPS), path.steps.max())
        return hits.at[jnp.where(there, mine, count)].set(found, mode="drop")

    return jax.lax.fori_loop(jnp.int32(0), (going + _PART - 1) // _PART, part, hits)


def _in_kernels(
    volume: Volume, paths: Path, passing: Passing | None, *, interpret: bool = False
) -> Int[Array, " n"]:
    """Few rays by each of many kernels, which Triton compiles; or `interpret`ed, by any machine."""
    from jax.experimental import pallas
    from jax.experimental.pallas import triton

    count = paths.steps.shape[0]
    given, form = jax.tree.flatten(jax.lax.stop_gradient((volume, paths, passing)))

    def kernel(*memory: Any) -> None:
        volume, paths, passing = jax.tree.unflatten(form, memory[:-1])
        lane = pallas.program_id(0) * _OF_KERNEL + jnp.arange(_OF_KERNEL, dtype=jnp.int32)
        there = lane < count

        def mine(column: Any) -> Array:
            return triton.load(column.at[lane], mask=there, other=0)

        def read(words: Any, at: Array) -> Array:
            return triton.load(words.at[at])

        volume = jax.tree.map(lambda leaf: leaf if leaf.shape else leaf[...], volume)
        paths, passing = jax.tree.map(mine, (paths, passing))
        hits, _ = _walked(volume, paths, passing, jnp.int32(0), None, read)
        triton.store(memory[-1].at[lane], hits, mask=there)

    anywhere = pallas.BlockSpec(memory_space=pallas.ANY)
    return pallas.pallas_call(
        kernel,
        out_shape=jax.ShapeDtypeStruct((count,), jnp.int32),
        grid=(-(-count // _OF_KERNEL),),
        in_specs=[anywhere] * len(given),
        out_specs=anywhere,
        compiler_params=triton.CompilerParams(num_warps=_WARPS),
        interpret=interpret,
    )(*given)


_State = tuple[Int[Array, ""], Int[Array, " n"], Passing | None]


def _walked(
    volume: Volume,
    paths: Path,
    passing: Passing | None,
    begin: Int[Array, ""],
    end: Int[Array, ""] | None,
    read: Read = gathered,
) -> tuple[Int[Array, " n"], Passing | None]:
    """Where rays hit in steps from `begin` until `end`, or until all have ended, and what they then know."""

    def going(hits: Int[Array, " n"], step: Int[Array, ""]) -> Array:
        return (hits < 0) & (step < paths.steps)

    def unfinished(state: _State) -> Array:
        step, hits, _ = state
        return step < (jnp.where(hits < 0, paths.steps, 0).max() if end is None else end)

    def advance(state: _State) -> _State:
        step, hits, known = state
        found, then = take_step(volume, paths, step, known, read)
        on = going(hits, step)
        hits, known = jax.tree.map(lambda new, old: jnp.where(on, new, old), (found, then), (hits, known))
        return step + 1, hits, known

    nowhere = jnp.full(paths.steps.shape, -1, dtype=jnp.int32)
    return jax.lax.while_loop(unfinished, advance, (begin, nowhere, passing))[1:]
