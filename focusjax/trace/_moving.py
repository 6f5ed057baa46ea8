"""Rays that each have a time, through layers of things that move.

Layers of a body that are peeled once, at a key time, serve for a span of times around it, without moving a
sample: it is the rays that are moved, each by its own time (see `focusjax.trace._body_motion`), and nothing
is repeated as ghosts. Of several bodies a ray sees the one that it meets at the largest disparity.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax.geometry import Camera, LensRay
from focusjax.layers import Layers, RangePyramid
from focusjax.lens import AbstractLens
from focusjax.trace._body_motion import BodyMotion, moved_ray
from focusjax.trace._emitters import Emitters, may_emit, split_at_once
from focusjax.trace._march import first_hits
from focusjax.trace._radiances import (
    Seen,
    TracedScene,
    disparity_of,
    lens_rays,
    met_at,
    on_grid,
    traced_scene,
)
from focusjax.trace._ranges import narrowed
from focusjax.trace._samples import Starts
from focusjax.trace._walk import path_of

_STIR = 0x9E3779B1
"""By which chances of one body are made independent of another's."""


class MovingLayers(eqx.Module):
    """Layers of what moves as one body, for the times of a span.

    Attributes:
        scene: the layers as rays read them, with the key camera that they are seen from; without what their
            emitters have in excess.
        ranges: disparities over any square of them.
        motion: where they are at those times.
        emitters: those of the layers; None where there are none.
        stir: changes the chances of rays, for those of bodies to be independent.
        beyond: disparity of what passes it: 0, the background, or -1, what other bodies show.
    """

    scene: TracedScene
    ranges: RangePyramid
    motion: BodyMotion
    emitters: Emitters | None
    stir: UInt[Array, ""]
    beyond: Float[Array, ""]


def moving_layers(
    layers: Layers,
    camera: Camera,
    lens: AbstractLens,
    matrices: Float[np.ndarray, "m 4 4"],
    begin: float,
    end: float,
    *,
    number: int,
    backdrop: bool,
) -> MovingLayers:
    """The layers of one body with how it moves between two times; see `MovingLayers` and `BodyMotion`.

    One matrix is that of a body that is seen as by `camera` all the while.
    """
    real = layers.ranges.overall.dtype
    motion = BodyMotion(
        camera,
        layers.camera,
        jnp.asarray(matrices[:, :3], dtype=real),
        jnp.asarray(begin, dtype=real),
        jnp.asarray(end, dtype=real),
    )
    emitters = None
    if may_emit(layers):
        # What stands still in the axes of rays is split as a still picture's layers are, by the same program.
        moves = motion if len(matrices) > 1 else None
        layers, emitters = split_at_once(layers, lens, moves)
    return MovingLayers(
        traced_scene(layers),
        layers.ranges,
        motion,
        emitters,
        jnp.asarray(number * _STIR & 0xFFFFFFFF, dtype=jnp.uint32),
        jnp.asarray(0.0 if backdrop else -1.0, dtype=real),
    )


def seen_in_motion(
    bodies: tuple[MovingLayers, ...],
    camera: Camera,
    lens: AbstractLens,
    starts: Starts,
    time: Float[Array, " n"],
    together: int,
) -> Seen:
    """What n rays see of bodies that move: of each ray what is nearest at its `time`, of the bodies' span.

    The lens makes its rays in the axes of `camera`. They start in groups of `together` that lie close
    to one another in pixel and time: all first ones of groups, then all second ones, and so on.
    """
    rays = lens_rays(camera, lens, starts)
    seen: Seen | None = None
    for body in bodies:
        along, hits, now = met_in_motion(body, rays, starts.chance, time, together)
        radiance, _ = jax.vmap(lambda ray, hit, body=body: met_at(body.scene.surface, ray, hit))(along, hits)
        found = Seen(radiance, rays.weight, now)
        if seen is not None:
            nearer, before = found.disparity > seen.disparity, seen
            found = jax.tree.map(lambda a, b, nearer=nearer: jnp.where(nearer, a, b), found, before)
        seen = found
    assert seen is not None
    return seen


def met_in_motion(
    body: MovingLayers,
    rays: LensRay,
    chance: UInt[Array, " n"] | None,
    time: Float[Array, " n"],
    together: int,
) -> tuple[LensRay, Int[Array, " n"], Float[Array, " n"]]:
    """What n rays meet of one body; they are laid out as for `seen_in_motion`.

    They are in output pixels of the camera in whose axes the lens makes them; what has no weight meets
    nothing.

    Returns:
        The rays in the axes of the body and in units of its grid, the samples that they meet first, -1 for
        none, and at which disparity, that of `beyond` for none.
    """
    motion, matrices = body.motion, body.motion.at(time)

    def line(ray: LensRay, matrix: Float[Array, "3 4"]) -> tuple[LensRay, Array, Array]:
        moved, depth, along = moved_ray(ray, motion.camera, motion.key, matrix)
        return on_grid(moved, body.scene.grid), depth, along

    rays, depth, along = jax.vmap(line)(rays, matrices)
    grouped = jax.tree.map(lambda a: a.reshape(together, -1, *a.shape[1:]), rays)

    def range_of(group: LensRay) -> tuple[Array, Array, Array]:
        def box(least: Float[Array, ""], largest: Float[Array, ""]) -> tuple[Array, Array]:
            ends = [group.a + group.b * w for w in (least, largest)]
            low, high = (end.min(axis=0) for end in ends), (end.max(axis=0) for end in ends)
            return jnp.minimum(*low), jnp.maximum(*high)

        return narrowed(body.ranges, box)

    least, largest, deepest = jax.vmap(range_of, in_axes=1)(grouped)
    paths = jax.vmap(path_of)(rays, jnp.tile(least, together), jnp.tile(largest, together))
    # A ray that runs backwards among what has turned by more than a quarter sees none of it.
    paths = dataclasses.replace(paths, steps=jnp.where((along > 0) & (rays.weight > 0), paths.steps, 0))
    volume = dataclasses.replace(body.scene.volume, deepest=deepest.max())
    hits = first_hits(volume, paths, None if chance is None else chance ^ body.stir)
    there = jax.vmap(lambda hit: disparity_of(body.scene.surface, hit))(hits)
    ahead = 1.0 - depth * there
    met = (hits >= 0) & (ahead > 0)
    now = jnp.where(met, along * there / jnp.where(met, ahead, 1.0), body.beyond)
    return rays, jnp.where(met, hits, -1), now
