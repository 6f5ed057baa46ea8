"""What given lens rays bring back from prepared layers."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._parallel import in_parallel
from focusjax.geometry import Camera, LensRay
from focusjax.layers import Grid, Layers
from focusjax.lens import AbstractLens
from focusjax.trace._colour import Surface, disparity_of, radiance_at, surface_of
from focusjax.trace._march import first_hits
from focusjax.trace._ranges import disparity_range
from focusjax.trace._starts import lens_rays
from focusjax.trace._walk import Volume, make_volume, path_of

_PIXELS_AT_ONCE = 1 << 16


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


@eqx.filter_jit
def disparity_ranges(
    layers: Layers, lens: AbstractLens, pixel_filter: str = "box"
) -> tuple[Float[Array, " p"], Float[Array, " p"], Int[Array, " p"]]:
    """Least and largest disparity that rays of each pixel can meet, and layer count, row-major."""
    pixels = _some_pixels(layers.camera)
    found = jax.lax.map(lambda some: _ranges_of(some, layers, lens, pixel_filter), pixels)
    count = layers.camera.width * layers.camera.height
    least, largest, depth = (a.reshape(-1)[:count] for a in found)
    return least, largest, depth


def ranges_at_once(
    layers: Layers, lens: AbstractLens, pixel_filter: str = "box"
) -> tuple[Float[Array, " p"], Float[Array, " p"], Int[Array, " p"]]:
    """`disparity_ranges` by all cores, of what JAX does not trace."""
    pixels = _some_pixels(layers.camera)
    found = in_parallel(lambda some: _ranges_of(jnp.asarray(some), layers, lens, pixel_filter), pixels)
    count = layers.camera.width * layers.camera.height
    least, largest, depth = (jnp.concatenate(a)[:count] for a in zip(*found, strict=True))
    return least, largest, depth


def _some_pixels(camera: Camera) -> Int[np.ndarray, "k n"]:
    """Row-major numbers of all pixels, some at a time to hold little at once.

    The last one is repeated to fill them.
    """
    count = camera.width * camera.height
    size = min(count, _PIXELS_AT_ONCE)
    return np.minimum(np.arange(-(-count // size) * size, dtype=np.int32), count - 1).reshape(-1, size)


@eqx.filter_jit
def _ranges_of(
    pixels: Int[Array, " n"], layers: Layers, lens: AbstractLens, pixel_filter: str
) -> tuple[Float[Array, " n"], Float[Array, " n"], Int[Array, " n"]]:
    width = layers.camera.width

    def one(index: Int[Array, ""]) -> tuple[Array, Array, Array]:
        film = jnp.stack([index % width, index // width]) + 0.5
        return disparity_range(layers, lens, film, pixel_filter)

    return jax.vmap(one)(pixels)


def first_met(
    scene: TracedScene,
    lens: AbstractLens,
    film: Float[Array, "p s 2"],
    pupil: Float[Array, "p s 2"],
    chance: UInt[Array, "p s"] | None,
    least: Float[Array, " p"],
    largest: Float[Array, " p"],
    *,
    depth: int,
) -> tuple[LensRay, Int[Array, "p s"]]:
    """S rays of each of p places in the picture, in grid units, and the samples that they meet.

    Args:
        scene: what rays go through.
        lens: where they come from.
        film: film points in pixels.
        pupil: points of the opening.
        chance: decides where rays stop among surfaces that are there in part only; None where all are whole.
        least: least disparity that the rays of each place can meet.
        largest: largest one.
        depth: most layers that any of them can meet.
    """
    grid = scene.grid

    rays = lens_rays(scene.camera, lens, film, pupil)
    rays = LensRay(rays.a * grid.supersampling + grid.margin, rays.b * grid.supersampling, rays.weight)
    paths = jax.vmap(jax.vmap(path_of, in_axes=(0, None, None)))(rays, least, largest)
    paths, chance = jax.tree.map(lambda a: a.reshape(-1), (paths, chance))
    return rays, first_hits(scene.volume, paths, chance, depth=depth).reshape(rays.weight.shape)


def radiances(
    scene: TracedScene,
    lens: AbstractLens,
    film: Float[Array, "p s 2"],
    pupil: Float[Array, "p s 2"],
    chance: UInt[Array, "p s"] | None,
    least: Float[Array, " p"],
    largest: Float[Array, " p"],
    *,
    depth: int,
) -> tuple[Float[Array, "p s 3"], Float[Array, "p s"], Float[Array, "p s"]]:
    """The radiance along s rays of each of p places, the share of it that arrives, and where it is from.

    That is a disparity. Arguments are those of `first_met`.
    """
    rays, hits = first_met(scene, lens, film, pupil, chance, least, largest, depth=depth)
    along = jax.vmap(jax.vmap(lambda ray, hit: radiance_at(scene.surface, ray, hit)))(rays, hits)
    return along, rays.weight, jax.vmap(jax.vmap(functools.partial(disparity_of, scene.surface)))(hits)
