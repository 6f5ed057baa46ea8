"""The light of the emitters of a body that moves while a shutter is open.

Places on emitters are drawn as for a still picture (`focusjax.trace._emitter_pairs`), in the axes in which
their body stands still, and each ray of a pair has a time, too: one of those at which its film point may see
the place, and it counts for the share of the light that arrives meanwhile. With q' the place there, w' =
w'(q') the surface's disparity and q, w the same in the picture at that time (`focusjax.trace._body_motion`),
the integral over the emitter's surface is

    integral of s(v) W L |1 - g . b| / |det dq/dv| |det dq/dq'| dq',        g = dw/dq' (dq/dq')^-1.

A ray is stopped by what it meets first of the emitter's own body, as in a still picture, and by any other
body that it meets before it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt

from focusjax._few import sum_of_few
from focusjax._programs import jit
from focusjax._whole import taken
from focusjax.geometry import LensRay
from focusjax.lens import AbstractLens
from focusjax.trace._body_motion import BodyMotion
from focusjax.trace._emitter_pairs import (
    FARTHEST_OFF,
    Drawing,
    Pairs,
    carried,
    light_of_pairs,
    reached,
    together_of,
)
from focusjax.trace._in_parts import in_parts
from focusjax.trace._moving import MovingLayers, met_in_motion
from focusjax.trace._timed import RowShares, Timing

_BEFORE = 1.0 + 1e-4
"""Ratio of the disparities of what hides an emitter and the emitter, for rounding."""
_BESIDE = 0.05
"""Pixels around a footprint, for places that are not quite between those of two times."""
_BENT = 0.02
"""The same as a share of the way from one to the other."""


@jit
def moving_light(
    body: MovingLayers,
    others: tuple[MovingLayers, ...],
    lens: AbstractLens,
    timing: Timing,
    shares: RowShares,
    seed: UInt[Array, ""],
    *,
    rays: int,
    pixel_filter: str,
) -> Float[Array, "p 3"]:
    """The light that each pixel gets from emitters of a body in one span, row-major.

    `others` are all other bodies, `timing` and `shares` say when the light of rows arrives and how much of it
    in the span, and `rays` are those of a pixel in the span, on the average.
    """
    emitters, motion = body.emitters, body.motion
    assert emitters is not None
    slots, height = emitters.slots, motion.camera.height
    low, high = jnp.asarray(shares.low), jnp.minimum(jnp.asarray(shares.high), 1.0)
    together = together_of(rays)

    def aimed(draw: Drawing, lens: AbstractLens, some: Pairs) -> tuple[Array, ...]:
        """Rays, in output pixels, what each carries per power of its slot, its disparity, time and chance."""
        t, u, v, x, y = draw.points(some, 5)
        film, drawn = draw.film(some, x, y), draw.places(some, body.scene.grid, u, v)
        seen = jax.vmap(lambda *one: _when_seen(motion, lens, *one))(film, drawn.place, drawn.disparity)
        ends = (motion.begin + share * (motion.end - motion.begin) for share in seen)
        first, last = (
            jnp.clip(timing.moment(end, some.row, height), low[some.row], high[some.row]) for end in ends
        )
        time = timing.times(first + (last - first) * t, some.row, height)
        near = FARTHEST_OFF / body.scene.grid.supersampling

        def one(matrix: Array, film: Array, place: Array, w: Array, slope: Array) -> tuple[Array, ...]:
            there, now, slope, larger = _moved(motion, matrix, place, w, slope)
            ray, value = carried(motion.camera, lens, film, there, now, slope, near)
            return *ray.a, *ray.b, value * larger, now

        *ray, value, now = jax.vmap(one)(motion.at(time), film, drawn.place, drawn.disparity, drawn.slope)
        return *ray, drawn.of_slot(value) * (last - first), now, time, drawn.slot, draw.chances(some)

    def brought(draw: Drawing, lens: AbstractLens, some: Pairs) -> tuple[Float[Array, " n"], ...]:
        a_x, a_y, b_x, b_y, value, now, time, slot, chance = in_parts(
            lambda columns: aimed(draw, lens, Pairs(*columns)), some.columns()
        )
        ray = LensRay(jnp.stack([a_x, a_y], axis=-1), jnp.stack([b_x, b_y], axis=-1), value)
        _, hits, _ = met_in_motion(body, ray, chance, time, together)
        seen = reached(slots, body.scene.volume, hits, some.cluster, slot)
        for other in others:
            _, hits, before = met_in_motion(other, ray, chance, time, together)
            seen &= (hits < 0) | (before <= now * _BEFORE)
        value = jnp.where(seen, value, 0.0)
        return tuple(value * taken(plane, slot) for plane in slots.power)

    return light_of_pairs(emitters, motion.camera, lens, brought, seed, rays=rays, pixel_filter=pixel_filter)


def _when_seen(
    motion: BodyMotion,
    lens: AbstractLens,
    film: Float[Array, "2"],
    place: Float[Array, "2"],
    disparity: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """From when until when rays of a film point may pass a place, as shares of its time; alike if never.

    With d the way from the middle of the footprint to the place and R the footprint's radius, that is while
    |d| < R. Between two times d is taken to be straight, and R to be the larger one.
    """

    def at(matrix: Float[Array, "3 4"]) -> tuple[Array, Array]:
        there, now, _ = motion.place(place, disparity, matrix)
        middle, radius = lens.footprint(motion.camera, film, now)
        return there - middle, radius

    way, radius = jax.vmap(at)(motion.matrices)
    segments = len(way) - 1
    if not segments:
        return disparity * 0.0, disparity * 0.0 + 1.0
    begin, step = way[:-1], way[1:] - way[:-1]
    square, half = (step**2).sum(axis=1), (begin * step).sum(axis=1)
    radius = jnp.maximum(radius[1:], radius[:-1]) + _BESIDE + _BENT * jnp.sqrt(square)
    # |begin + s step|^2 = radius^2, for s from 0 to 1.
    inside = half**2 - square * ((begin**2).sum(axis=1) - radius**2)
    root = jnp.sqrt(jnp.maximum(inside, 0.0))
    safe = jnp.maximum(square, 1e-9)
    from_, until = (jnp.clip((-half + sign * root) / safe, 0.0, 1.0) for sign in (-1.0, 1.0))
    still = square < 1e-9
    near = (begin**2).sum(axis=1) < radius**2
    there = jnp.where(still, near, (inside > 0) & (until > from_))
    number = jnp.arange(segments, dtype=from_.dtype)
    first = jnp.where(there, number + jnp.where(still, 0.0, from_), segments).min() / segments
    last = jnp.where(there, number + jnp.where(still, 1.0, until), 0.0).max() / segments
    return jnp.minimum(first, last), last


def _moved(
    motion: BodyMotion,
    matrix: Float[Array, "3 4"],
    place: Float[Array, "2"],
    disparity: Float[Array, ""],
    slope: Float[Array, "2"],
) -> tuple[Float[Array, "2"], Float[Array, ""], Float[Array, "2"], Float[Array, ""]]:
    """A place on a surface, its disparity and slopes, in the picture at a time; and how much larger it is.

    That is 0 where it is turned away or not ahead of the lens.
    """

    def at(along: Float[Array, "2"]) -> tuple[Array, tuple[Array, Array, Array]]:
        there, now, ahead = motion.place(along, disparity + sum_of_few(slope * (along - place)), matrix)
        return jnp.append(there, now), (there, now, ahead)

    ((x_x, x_y), (y_x, y_y), (w_x, w_y)), (there, now, ahead) = jax.jacfwd(at, has_aux=True)(place)
    larger = x_x * y_y - x_y * y_x
    seen = (larger > 0) & (ahead > 0)
    safe = jnp.where(seen, larger, 1.0)
    slope = jnp.stack([w_x * y_y - w_y * y_x, w_y * x_x - w_x * x_y]) / safe
    return there, now, slope, jnp.where(seen, larger, 0.0)
