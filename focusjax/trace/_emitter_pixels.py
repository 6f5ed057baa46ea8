"""Which pixels may see a cluster of emitters: a rectangle of them."""

import itertools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.trace._body_motion import BodyMotion

_ROUNDS = 4
_MARGIN = 0.04
"""Of the rectangle's extent: for footprints larger between the film points where they are evaluated."""


def pixels_that_see(
    camera: Camera,
    lens: AbstractLens,
    low: Float[Array, "2"],
    high: Float[Array, "2"],
    disparities: Float[Array, "2"],
    wide: float,
) -> tuple[Int[Array, "2"], Int[Array, "2"]]:
    """First column and row, and numbers of columns and rows, of the pixels whose rays may pass a box.

    The footprint of a film point p is a disk with the centre c(p) and radius r(p), so that p sees q only if
    p is within r(p) of q - (c(p) - p). Of a rectangle of film points, starting with the box itself, the
    footprints of nine points bound the next rectangle; a few rounds suffice, as r changes slowly. None
    exceeds the lens's reach.

    The box goes from `low`, its left and top, to `high` in output pixels, and from the least to the largest
    of `disparities` in 1/m; film points lie up to `wide` pixels off their pixel's centre, along x and y.
    """
    shares = jnp.array([(x, y) for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)], dtype=low.dtype)
    reach = jax.vmap(lambda disparity: lens.reach(camera, disparity))(disparities).max()

    def bounds(film: Float[Array, "2"], disparity: Float[Array, ""]) -> tuple[Array, Array]:
        centre, radius = lens.footprint(camera, film, disparity)
        return film - centre - radius, film - centre + radius

    def widen(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        first, last = ends
        films = first[None] + shares * (last - first)[None]
        over_films = jax.vmap(bounds, in_axes=(0, None))
        below, above = jax.vmap(over_films, in_axes=(None, 0))(films, disparities)
        below, above = below.min(axis=(0, 1)), above.max(axis=(0, 1))
        return jnp.maximum(low + below, low - reach), jnp.minimum(high + above, high + reach)

    first, last = jax.lax.fori_loop(0, _ROUNDS, widen, (low, high))
    margin = _MARGIN * (last - first) + wide + 0.5
    size = jnp.array([camera.width, camera.height], dtype=low.dtype)
    # Pixel k has its centre at k + 0.5.
    first = jnp.clip(jnp.floor(first - margin), 0, size)
    last = jnp.clip(jnp.ceil(last + margin), first, size)
    return first.astype(jnp.int32), (last - first).astype(jnp.int32)


def pixels_that_see_in_motion(
    motion: BodyMotion,
    lens: AbstractLens,
    low: Float[Array, "2"],
    high: Float[Array, "2"],
    disparities: Float[Array, "2"],
    wide: float,
) -> tuple[Int[Array, "2"], Int[Array, "2"]]:
    """The same of the pixels whose rays may pass a box of a body at any of its times.

    The rectangle around those of all times at which its place is known: between two, what is straight in
    space is so in the picture. There is none if any of the box is not ahead of the lens all the while. The
    box is that of the body's key camera.
    """
    axes = (low[0], high[0]), (low[1], high[1]), (disparities[0], disparities[1])
    corners = jnp.stack([jnp.stack(corner) for corner in itertools.product(*axes)])

    def at(matrix: Float[Array, "3 4"]) -> tuple[Array, Array, Array]:
        place, now, ahead = jax.vmap(lambda c: motion.place(c[:2], c[2], matrix))(corners)
        first, extent = pixels_that_see(
            motion.camera, lens, place.min(axis=0), place.max(axis=0), jnp.stack([now.min(), now.max()]), wide
        )
        return first, first + extent, ahead.min() > 0

    first, last, ahead = jax.lax.map(at, motion.matrices)
    first = first.min(axis=0)
    return first, jnp.where(ahead.all(), last.max(axis=0) - first, 0)
