"""The walks of many rays at once: those that have ended make room for those that go on.

Most rays meet something within two or three steps, a few pass under a silhouette for dozens. Vmapped, a loop
goes on for all of them until the last has ended, and four steps of five are for rays that have ended
already. Here rays are walked for a few steps, those that go on are moved together, and so on, each round
half as long as all before it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, UInt

from focusjax.trace._walk import Passing, Path, Volume, take_step

_TOGETHER = 4096
"""Rays walked at a time, few enough for all that is known of them to stay in the cache of a processor."""
_ROW = 64
_FEWEST_STEPS = 2

State = tuple[Int[Array, " _"], Passing | None]
"""Where each ray has hit, -1 if nowhere yet; and what it knows of the surfaces that let it through."""


def first_hits(
    volume: Volume, paths: Path, chance: UInt[Array, " n"] | None = None, *, depth: int
) -> Int[Array, " n"]:
    """As `first_hit`, for the n rays of `paths`."""
    count = paths.a_x.shape[0]
    passing = None if volume.opacity is None or chance is None else Passing(jnp.zeros_like(chance), chance)
    state: State = (jnp.full(count, -1, dtype=jnp.int32), passing)

    def a_round(work: tuple[Array, Array, Array, State]) -> tuple[Array, Array, Array, State]:
        rays, left, begin, state = work
        end = begin + jnp.maximum(_FEWEST_STEPS, begin // 2)

        def some(number: Array, work: tuple[Array, Array, State]) -> tuple[Array, Array, State]:
            going_on, going, state = work
            first = number * _TOGETHER
            mine = jax.lax.dynamic_slice(rays, (first,), (_TOGETHER,))
            now, goes_on = _walk_on(volume, paths, state, mine, begin, end, depth)
            valid = first + jnp.arange(_TOGETHER, dtype=jnp.int32) < left
            place = jnp.where(valid, mine, count)
            state = jax.tree.map(lambda all_, new: all_.at[place].set(new, mode="drop"), state, now)
            kept, more = _moved_together(mine, valid & goes_on)
            return jax.lax.dynamic_update_slice(going_on, kept, (going,)), going + more, state

        parts = (left + _TOGETHER - 1) // _TOGETHER
        nobody = (jnp.zeros_like(rays), jnp.int32(0), state)
        going_on, going, state = jax.lax.fori_loop(jnp.int32(0), parts, some, nobody)
        return going_on, going, end, state

    # Room to read and write a whole part wherever it begins.
    room = count + -count % _TOGETHER + _TOGETHER
    everybody = jnp.minimum(jnp.arange(room, dtype=jnp.int32), count - 1)
    work = (everybody, jnp.int32(count), jnp.int32(0), state)
    return jax.lax.while_loop(lambda work: work[1] > 0, a_round, work)[3][0]


def _walk_on(
    volume: Volume,
    paths: Path,
    state: State,
    rays: Int[Array, " m"],
    begin: Int[Array, ""],
    end: Int[Array, ""],
    depth: int,
) -> tuple[State, Bool[Array, " m"]]:
    """The state of some of the `rays`, walked from one step to another, and which of them go on."""
    path, passing = jax.tree.map(lambda a: a.at[rays].get(mode="promise_in_bounds"), (paths, state[1]))

    def one(step: Int[Array, ""], now: State) -> State:
        new = jax.vmap(lambda p, known: take_step(volume, p, step, known, depth=depth))(path, now[1])
        going = (now[0] < 0) & (step < path.steps)
        return jax.tree.map(lambda a, b: jnp.where(going, a, b), new, now)

    nowhere = jnp.full(rays.shape, -1, dtype=jnp.int32)
    now = jax.lax.fori_loop(begin, end, one, (nowhere, passing))
    return now, (now[0] < 0) & (path.steps > end)


def _moved_together(
    lanes: Int[Array, " m"], kept: Bool[Array, " m"]
) -> tuple[Int[Array, " m"], Int[Array, ""]]:
    """The lanes that are kept, in order, at the front; and how many they are."""
    # In rows, as XLA adds up a long array one by one in many passes.
    rows = kept.reshape(-1, _ROW).astype(jnp.int32)
    total = rows.sum(axis=1, dtype=jnp.int32)
    before = (jnp.cumsum(total, dtype=jnp.int32) - total)[:, None] + jnp.cumsum(rows, axis=1) - rows
    place = jnp.where(kept, before.reshape(-1), kept.shape[0])
    return jnp.zeros_like(lanes).at[place].set(lanes, mode="drop"), total.sum(dtype=jnp.int32)
