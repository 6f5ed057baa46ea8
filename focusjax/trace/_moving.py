"""Rays that each have a time, through layers of things that move.

A lens ray is a straight line in the axes of the camera at its time. What moves as a rigid body (or as any
affine map, zooming cameras included) stands still in axes of its own, and there the ray is a straight line
again. So layers of a body that are peeled once, at a key time, serve for a span of times around it, without
moving a sample: it is the rays that are moved, each by its own time, and nothing is repeated as ghosts.

With P(z) = (X0 + m z, -z) the ray in the camera's axes at depth z, and M the map from there to the axes of
the key camera, of which o = M P(0) and d is the image of (m, -1), depth there is z' = z0 + g z with z0 =
-o_z and g = -d_z, and the ray crosses the plane z' = 0 at o - d z0 / g with slopes d / g: by these it is
q'(w') = a' + b' w' (see `focusjax.geometry.LensRay`), exactly. What it meets at disparity w' there is at

    w = g w' / (1 - z0 w')

at the ray's own time. Of several bodies the one with the largest w is what the ray sees.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax.geometry import Camera, LensRay
from focusjax.layers import Layers, RangePyramid
from focusjax.lens import AbstractLens
from focusjax.trace._colour import disparity_of, met_at
from focusjax.trace._march import first_hits
from focusjax.trace._radiances import Seen, TracedScene, on_grid, traced_scene
from focusjax.trace._samples import Starts
from focusjax.trace._starts import lens_rays
from focusjax.trace._timed import interpolated
from focusjax.trace._walk import path_of

_ROUNDS = 4
_SLACK = 1.0
"""Samples."""
_STIR = 0x9E3779B1
"""By which chances of one body are made independent of another's."""


class MovingLayers(eqx.Module):
    """Layers of what moves as one body, for the times of a span.

    Attributes:
        scene: the layers as rays read them, with the key camera that they are seen from.
        ranges: disparities over any square of them.
        matrices: maps [m, 3, 4] from the axes of the camera to those of the key camera in which the body
            stands still, at times evenly spaced from the first to the last of the span; straight between.
        begin: the first of these times.
        end: the last one.
        stir: changes the chances of rays, for those of bodies to be independent.
        beyond: disparity of what passes it: 0, the background, or -1, what other bodies show.
    """

    scene: TracedScene
    ranges: RangePyramid
    matrices: Float[Array, "m 3 4"]
    begin: Float[Array, ""]
    end: Float[Array, ""]
    stir: UInt[Array, ""]
    beyond: Float[Array, ""]


def moving_layers(
    layers: Layers,
    matrices: Float[np.ndarray, "m 4 4"],
    begin: float,
    end: float,
    *,
    number: int,
    backdrop: bool,
) -> MovingLayers:
    """The layers of one body with how it moves between two times; see `MovingLayers`."""
    real = layers.ranges.overall.dtype
    return MovingLayers(
        traced_scene(layers),
        layers.ranges,
        jnp.asarray(matrices[:, :3], dtype=real),
        jnp.asarray(begin, dtype=real),
        jnp.asarray(end, dtype=real),
        jnp.asarray(number * _STIR & 0xFFFFFFFF, dtype=jnp.uint32),
        jnp.asarray(0.0 if backdrop else -1.0, dtype=real),
    )


def moved_ray(
    ray: LensRay, camera: Camera, key: Camera, matrix: Float[Array, "3 4"]
) -> tuple[LensRay, Float[Array, ""], Float[Array, ""]]:
    """A ray in the axes in which a body stands still, z0 and g; see the head of this file.

    Args:
        ray: of `camera`.
        camera: as of the ray.
        key: the camera of the layers.
        matrix: from the axes of the one to those of the other.
    """
    slope, crossing = (ray.a - camera.principal_point) / camera.focal_px, ray.b / camera.focal_px
    turned = matrix[:, :3]
    origin = turned[:, 0] * crossing[0] - turned[:, 1] * crossing[1] + matrix[:, 3]
    direction = turned[:, 0] * slope[0] - turned[:, 1] * slope[1] - turned[:, 2]
    depth, along = -origin[2], -direction[2]
    safe = jnp.where(along > 0, along, 1.0)
    x, y = direction[0] / safe, direction[1] / safe
    a = key.principal_point + key.focal_px * jnp.stack([x, -y])
    b = key.focal_px * jnp.stack([origin[0] - x * depth, y * depth - origin[1]])
    return LensRay(a, b, ray.weight), depth, along


def seen_in_motion(
    bodies: tuple[MovingLayers, ...],
    camera: Camera,
    lens: AbstractLens,
    starts: Starts,
    time: Float[Array, " n"],
    together: int,
) -> Seen:
    """What n rays see of bodies that move: of each ray what is nearest at its time.

    Args:
        bodies: layers for the times of all rays.
        camera: in whose axes the lens makes its rays.
        lens: where they come from.
        starts: their film and aperture points: all first ones of groups of rays that lie close together in
            pixel and time, then all second ones, and so on.
        time: as of the bodies' span.
        together: rays of a group.
    """
    rays = lens_rays(camera, lens, starts)
    seen: Seen | None = None
    for body in bodies:
        found = _seen_of(body, camera, rays, starts.chance, time, together)
        if seen is not None:
            nearer, before = found.disparity > seen.disparity, seen
            found = jax.tree.map(lambda a, b, nearer=nearer: jnp.where(nearer, a, b), found, before)
        seen = found
    assert seen is not None
    return seen


def _seen_of(
    body: MovingLayers,
    camera: Camera,
    rays: LensRay,
    chance: UInt[Array, " n"] | None,
    time: Float[Array, " n"],
    together: int,
) -> Seen:
    """What rays see of one body; its disparity is that of `beyond` where they pass it."""
    length = jnp.where(body.end > body.begin, body.end - body.begin, 1.0)
    matrices = interpolated(body.matrices, (time - body.begin) / length)

    def line(ray: LensRay, matrix: Float[Array, "3 4"]) -> tuple[LensRay, Array, Array]:
        moved, depth, along = moved_ray(ray, camera, body.scene.camera, matrix)
        return on_grid(moved, body.scene.grid), depth, along

    rays, depth, along = jax.vmap(line)(rays, matrices)
    grouped = jax.tree.map(lambda a: a.reshape(together, -1, *a.shape[1:]), rays)
    least, largest, deepest = jax.vmap(lambda group: _range(body.ranges, group), in_axes=1)(grouped)
    paths = jax.vmap(path_of)(rays, jnp.tile(least, together), jnp.tile(largest, together))
    # A ray that runs backwards among what has turned by more than a quarter sees none of it.
    paths = dataclasses.replace(paths, steps=jnp.where(along > 0, paths.steps, 0))
    volume = dataclasses.replace(body.scene.volume, deepest=deepest.max())
    hits = first_hits(volume, paths, None if chance is None else chance ^ body.stir)
    there = jax.vmap(lambda hit: disparity_of(body.scene.surface, hit))(hits)
    ahead = 1.0 - depth * there
    met = (hits >= 0) & (ahead > 0)
    now = jnp.where(met, along * there / jnp.where(met, ahead, 1.0), body.beyond)
    hits = jnp.where(met, hits, -1)
    found = jax.vmap(lambda ray, hit: met_at(body.scene.surface, ray, hit))(rays, hits)
    return Seen(found.radiance, rays.weight, now)


def _range(ranges: RangePyramid, rays: LensRay) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
    """Least and largest disparity that some rays, in grid units, can meet, and layer count.

    As `disparity_range`.
    """

    def narrow(_: Any, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        ends = [rays.a + rays.b * w for w in state[:2]]
        low = jnp.minimum(*(end.min(axis=0) for end in ends)) - _SLACK
        high = jnp.maximum(*(end.max(axis=0) for end in ends)) + _SLACK
        least, largest, depth = ranges.query(low, high)
        return jnp.where(largest <= 0, 0.0, least), jnp.where(largest <= 0, 0.0, largest), depth

    overall = ranges.overall
    start = jnp.where(overall[1] > 0, overall[0], 0.0), overall[1], ranges.most_layers
    return jax.lax.fori_loop(0, _ROUNDS, narrow, start)
