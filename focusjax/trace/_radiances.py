"""What given lens rays see of layers: which surface each meets, and the radiance along it."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax._programs import jit
from focusjax._whole import divided, taken
from focusjax.geometry import Camera, LensRay
from focusjax.layers import Grid, Layers, Places, radiance_slopes
from focusjax.lens import AbstractLens
from focusjax.trace._gloss import GlossPlanes, gloss_at, gloss_planes
from focusjax.trace._in_parts import in_parts
from focusjax.trace._march import first_hits
from focusjax.trace._samples import Starts
from focusjax.trace._walk import Volume, make_volume, path_of


class Surface(eqx.Module):
    """The layers' appearance as flat planes.

    Attributes:
        places: from the flat index of a sample to its position in the next planes.
        radiance: red, green and blue, each [n]: means over the squares of samples.
        across: change of each of them per sample to the right [n].
        down: the same downwards.
        disparity: 1/m [n].
        background: red, green and blue at infinity, each [m] over the grid; of length 1 where it is the same
            all over.
        gloss: what to add for each ray; None where gloss is part of `radiance`.
        columns: samples per row (static).
        rows: rows (static).
    """

    places: Places
    radiance: tuple[Float[Array, " n"], ...]
    across: tuple[Float[Array, " n"], ...]
    down: tuple[Float[Array, " n"], ...]
    disparity: Float[Array, " n"]
    background: tuple[Float[Array, " m"], ...]
    gloss: GlossPlanes | None
    columns: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)


def surface_of(layers: Layers) -> Surface:
    """The flat planes of `layers`; what is flat there is the same arrays."""
    across, down = radiance_slopes(layers)
    return Surface(
        places=layers.places,
        radiance=_colours(layers.samples.radiance),
        across=across,
        down=down,
        disparity=layers.samples.disparity,
        background=_colours(layers.background),
        gloss=gloss_planes(layers),
        columns=layers.grid.columns,
        rows=layers.grid.rows,
    )


@jit
def _colours(radiance: Float[Array, "*n 3"]) -> tuple[Float[Array, " m"], ...]:
    """Red, green and blue."""
    return tuple(radiance[..., k].reshape(-1) for k in range(3))


def disparity_of(surface: Surface, hit: Int[Array, ""]) -> Float[Array, ""]:
    """Disparity of sample `hit`, 0 if that is -1."""
    number = surface.places.number(jnp.maximum(hit, 0))
    return jnp.where(hit >= 0, taken(surface.disparity, number), 0.0)


def met_at(
    surface: Surface, ray: LensRay, hit: Int[Array, ""]
) -> tuple[tuple[Float[Array, ""], ...], Float[Array, ""]]:
    """What `ray` (in grid units) sees in sample `hit`, or at infinity if that is -1.

    Red, green and blue along the ray, and the disparity of what it meets in 1/m, 0 at infinity. Radiance is
    linear across the sample, with the slopes of `radiance_slopes`.
    """
    met, index = hit >= 0, jnp.maximum(hit, 0)
    number, disparity = surface.places.number(index), disparity_of(surface, hit)
    x, y = ray.a[0] + ray.b[0] * disparity, ray.a[1] + ray.b[1] * disparity
    row, column = divided(divided(index, surface.columns * surface.rows)[1], surface.columns)
    dx = jnp.clip(x - column.astype(x.dtype) - 0.5, -0.5, 0.5)
    dy = jnp.clip(y - row.astype(x.dtype) - 0.5, -0.5, 0.5)
    behind = jnp.int32(0)
    if surface.background[0].size > 1:
        far_column = jnp.clip(jnp.floor(x).astype(jnp.int32), 0, surface.columns - 1)
        far_row = jnp.clip(jnp.floor(y).astype(jnp.int32), 0, surface.rows - 1)
        behind = far_row * surface.columns + far_column

    def look(mean: Array, across: Array, down: Array, far: Array) -> Float[Array, ""]:
        own, by_x, by_y = (taken(plane, number) for plane in (mean, across, down))
        return jnp.where(met, own + dx * by_x + dy * by_y, taken(far, behind))

    planes = zip(surface.radiance, surface.across, surface.down, surface.background, strict=True)
    radiance = tuple(look(*colour) for colour in planes)
    if surface.gloss is not None:
        gloss = gloss_at(surface.gloss, ray, jnp.where(met, disparity, 1.0), number)
        radiance = tuple(colour + jnp.where(met, gloss[k], 0.0) for k, colour in enumerate(radiance))
    return radiance, disparity


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

    Each can meet disparities from `least` to `largest` in 1/m, in the first `deepest` layers, or in all.
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
