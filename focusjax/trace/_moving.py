"""Rays that each have a time, through layers of things that move.

A lens ray is a straight line in the axes of the camera at its time. What moves as a rigid body (or as any
affine map, zooming cameras included) stands still in axes of its own, and there the ray is a straight line
again. So layers of a body that are peeled once, at a key time, serve for a span of times around it, without
moving a sample: it is the rays that are moved, each by its own time, and nothing is repeated as ghosts.

With P(z) = (X0 + m z, -z) the ray in the camera's axes at depth z, and M the map from there to the axes of
the
key camera, of which o = M P(0) and d is the image of (m, -1), depth there is z' = z0 + g z with z0 = -o_z and
g = -d_z, and the ray crosses the plane z' = 0 at o - d z0 / g with slopes d / g: by these it is q'(w') = a' +
b' w' (see `focusjax.geometry.LensRay`), exactly. What it meets at disparity w' there is at

    w = g w' / (1 - z0 w')

at the ray's own time. Of several bodies the one with the largest w is what the ray sees.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt

from focusjax.geometry import Camera, LensRay
from focusjax.layers import Layers, RangePyramid
from focusjax.lens import AbstractLens
from focusjax.trace._colour import radiance_at
from focusjax.trace._march import first_hits
from focusjax.trace._radiances import TracedScene, traced_scene
from focusjax.trace._starts import lens_rays
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


Front = tuple[Float[Array, "p s 3"], Float[Array, "p s"], Float[Array, "p s"]]
"""The radiance along rays, the share of it that arrives, and the disparity it comes from; -1 for nowhere."""


@eqx.filter_jit
def in_front(
    front: Front,
    body: MovingLayers,
    camera: Camera,
    lens: AbstractLens,
    film: Float[Array, "p s 2"],
    pupil: Float[Array, "p s 2"],
    time: Float[Array, "p s"],
    chance: UInt[Array, "p s"] | None,
) -> Front:
    """What rays see of `body` where it is before what is in `front`, else that.

    Args:
        front: of the bodies before it.
        body: layers for the time of all rays.
        camera: in whose axes the lens makes its rays.
        lens: where they come from.
        film: film points in pixels; the rays of a row lie close together in time.
        pupil: points of the opening.
        time: as of the body's span.
        chance: decides where rays stop among surfaces that are there in part only; None where all are whole.
    """

    def line(ray: LensRay, time: Array) -> tuple[LensRay, Array, Array]:
        moved, depth, along = moved_ray(ray, camera, body.scene.camera, _matrix_at(body, time))
        grid = body.scene.grid
        a, b = moved.a * grid.supersampling + grid.margin, moved.b * grid.supersampling
        return LensRay(a, b, moved.weight), depth, along

    rays, depth, along = jax.vmap(jax.vmap(line))(lens_rays(camera, lens, film, pupil), time)
    least, largest = jax.vmap(lambda rays: _range(body.ranges, rays))(rays)
    paths = jax.vmap(jax.vmap(path_of, in_axes=(0, None, None)))(rays, least, largest)
    # A ray that runs backwards among what has turned by more than a quarter sees none of it.
    paths = eqx.tree_at(lambda path: path.steps, paths, jnp.where(along > 0, paths.steps, 0))
    stirred = None if chance is None else (chance ^ body.stir).reshape(-1)
    paths = jax.tree.map(lambda a: a.reshape(-1), paths)
    hits = first_hits(body.scene.volume, paths, stirred, depth=body.scene.volume.layers)
    hits = hits.reshape(rays.weight.shape)
    surface = body.scene.surface
    number = surface.places.number(jnp.maximum(hits, 0))
    there = jnp.where(hits >= 0, surface.disparity[number], 0.0)
    beyond = 1.0 - depth * there
    met = (hits >= 0) & (beyond > 0)
    now = jnp.where(met, along * there / jnp.where(met, beyond, 1.0), body.beyond)
    hits = jnp.where(met, hits, -1)
    radiance = jax.vmap(jax.vmap(lambda ray, hit: radiance_at(surface, ray, hit)))(rays, hits)
    nearer = now > front[2]
    return jnp.where(nearer[..., None], radiance, front[0]), rays.weight, jnp.where(nearer, now, front[2])


def _matrix_at(body: MovingLayers, time: Float[Array, ""]) -> Float[Array, "3 4"]:
    nodes = body.matrices.shape[0]
    if nodes == 1:
        return body.matrices[0]
    length = jnp.where(body.end > body.begin, body.end - body.begin, 1.0)
    place = jnp.clip((time - body.begin) / length, 0.0, 1.0) * (nodes - 1)
    before = jnp.minimum(place.astype(jnp.int32), nodes - 2)
    share = place - before.astype(place.dtype)
    return body.matrices[before] + share * (body.matrices[before + 1] - body.matrices[before])


def _range(ranges: RangePyramid, rays: LensRay) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Least and largest disparity that some rays, in grid units, can meet: as `disparity_range`."""

    def narrow(_: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
        ends = [rays.a + rays.b * w for w in state]
        low = jnp.minimum(*(end.min(axis=0) for end in ends)) - _SLACK
        high = jnp.maximum(*(end.max(axis=0) for end in ends)) + _SLACK
        least, largest, _depth = ranges.query(low, high)
        return jnp.where(largest <= 0, 0.0, least), jnp.where(largest <= 0, 0.0, largest)

    overall = ranges.overall
    start = jnp.where(overall[1] > 0, overall[0], 0.0), overall[1]
    return jax.lax.fori_loop(0, _ROUNDS, narrow, start)
