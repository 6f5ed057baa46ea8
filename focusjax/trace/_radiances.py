"""What given lens rays see of layers."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera, LensRay
from focusjax.layers import Grid, Layers
from focusjax.lens import AbstractLens
from focusjax.trace._colour import Surface, met_at, surface_of
from focusjax.trace._in_parts import in_parts
from focusjax.trace._march import first_hits
from focusjax.trace._samples import Starts
from focusjax.trace._walk import Volume, make_volume, path_of


class TracedScene(eqx.Module):
    """Layers in the form that rays read them."""

    volume: Volume
    surface: Surface
    camera: Camera
    grid: Grid = eqx.field(static=True)


def traced_scene(layers: Layers) -> TracedScene:
    """The layers as rays read them."""
    return TracedScene(
        volume=make_volume(layers.cells, layers.disparity_scale, layers.opacity),
        surface=surface_of(layers),
        camera=layers.camera,
        grid=layers.grid,
    )


class Seen(eqx.Module):
    """What rays see.

    Attributes:
        radiance: red, green and blue along each ray, each [n].
        weight: share of the light that arrives [n].
        disparity: of what they meet [n] in 1/m; 0 at infinity.
    """

    radiance: tuple[Float[Array, " n"], ...]
    weight: Float[Array, " n"]
    disparity: Float[Array, " n"]


def first_met(
    scene: TracedScene,
    lens: AbstractLens,
    starts: Starts,
    least: Float[Array, " n"],
    largest: Float[Array, " n"],
    deepest: Int[Array, ""] | None = None,
) -> tuple[LensRay, Int[Array, " n"]]:
    """N rays, in grid units, and the samples that they meet first; -1 for none.

    Args:
        scene: what rays go through.
        lens: where they come from.
        starts: their film and aperture points.
        least: least disparity that each can meet.
        largest: largest one.
        deepest: most layers that any can meet; all of them if not given.
    """
    rays = on_grid(lens_rays(scene.camera, lens, starts), scene.grid)
    paths = jax.vmap(path_of)(rays, least, largest)
    volume = scene.volume
    if deepest is not None:
        volume = dataclasses.replace(volume, deepest=deepest)
    return rays, first_hits(volume, paths, starts.chance)


def lens_rays(camera: Camera, lens: AbstractLens, starts: Starts) -> LensRay:
    """The rays [n] of film points through points of the aperture."""

    def one(x: Array, y: Array, u: Array, v: Array) -> tuple[Array, ...]:
        ray = lens.ray(camera, jnp.stack([x, y]), jnp.stack([u, v]))
        return *ray.a, *ray.b, ray.weight

    columns = starts.x, starts.y, starts.u, starts.v
    a_x, a_y, b_x, b_y, weight = in_parts(lambda some: jax.vmap(one)(*some), columns, cpu=1 << 14)
    return LensRay(jnp.stack([a_x, a_y], axis=-1), jnp.stack([b_x, b_y], axis=-1), weight)


def on_grid(rays: LensRay, grid: Grid) -> LensRay:
    """Rays in units of the sample grid instead of output pixels."""
    return LensRay(rays.a * grid.supersampling + grid.margin, rays.b * grid.supersampling, rays.weight)


def seen_along(
    scene: TracedScene,
    lens: AbstractLens,
    starts: Starts,
    least: Float[Array, " n"],
    largest: Float[Array, " n"],
    deepest: Int[Array, ""] | None = None,
) -> Seen:
    """What n rays see; arguments are those of `first_met`."""
    rays, hits = first_met(scene, lens, starts, least, largest, deepest)
    radiance, disparity = jax.vmap(lambda ray, hit: met_at(scene.surface, ray, hit))(rays, hits)
    return Seen(radiance, rays.weight, disparity)
