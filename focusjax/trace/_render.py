"""The picture: rays of every pixel, vmapped, in blocks of bounded memory."""

import concurrent.futures
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._counts import require_counts
from focusjax._parallel import CORES
from focusjax.geometry import Camera, LensRay
from focusjax.layers import Grid, Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allot import FEWEST, allot, contrast, counts_for
from focusjax.trace._blocks import Block, make_blocks
from focusjax.trace._colour import Surface, radiance_at, surface_of
from focusjax.trace._march import first_hits
from focusjax.trace._ranges import disparity_range
from focusjax.trace._samples import RaySamples, ray_samples
from focusjax.trace._walk import Path, Volume, make_volume, path_of

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 23}


class _Scene(eqx.Module):
    """What one pixel needs to know."""

    volume: Volume
    surface: Surface
    camera: Camera
    grid: Grid = eqx.field(static=True)


def render(
    layers: Layers,
    lens: AbstractLens,
    *,
    rays: int = 64,
    even: bool = False,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Float[Array, "h w 3"]:
    """The picture that `lens` forms of `layers`: linear radiance, mean over the rays of each pixel.

    Args:
        layers: peeled for this lens or for one whose rays go farther.
        lens: any lens.
        rays: rays per pixel on the average; each has its own place in the pixel and on the lens. They go
            where what they may meet differs, up to eight times as many, and four where it is all alike; see
            `_allot`. Fewer than four are the same for all.
        even: give just `rays` to every pixel, be it plain or not.
        seed: chooses the rays; the same seed gives the same picture.
        progress: called with the share done, 0 to 1, now and then.

    Raises:
        ValueError: no rays, or a lens whose rays leave what the layers were peeled for.
    """
    require_counts(rays=rays)
    _check_reach(layers, lens)
    grid, camera = layers.grid, layers.camera
    least, largest, depth = _ranges(layers, lens)
    if even or rays < FEWEST:
        levels, counts = [rays], np.full(camera.width * camera.height, rays)
    else:
        levels, counts = counts_for(rays), allot(contrast(layers, lens, least, largest), rays)
    fewest = levels[0]
    samples = ray_samples(lens, levels, seed, chances=layers.samples.opacity is not None)
    scene = _Scene(
        volume=make_volume(layers.cells, layers.disparity_scale, layers.opacity),
        surface=surface_of(layers),
        camera=camera,
        grid=grid,
    )
    together = max(k for k in range(1, FEWEST + 1) if fewest % k == 0)
    at_once = _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20)
    blocks = make_blocks(
        counts // together, np.asarray(depth), layers.count, camera.width, max(1, at_once // together)
    )
    flat = np.zeros((camera.width * camera.height, 3), dtype=least.dtype)

    def trace(block: Block) -> np.ndarray:
        # The rays of the smaller counts come before those of a pixel's own.
        first = jnp.asarray(counts[block.pixels] - fewest + together * block.part)
        pixels = jnp.asarray(block.pixels)
        options = {"together": together, "depth": block.depth}
        return np.asarray(_trace_block(scene, lens, samples, pixels, first, least, largest, **options))

    # XLA runs one block on about one core, so a CPU is given a block per core at a time.
    workers = CORES if jax.default_backend() == "cpu" else 1
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        for done, (block, values) in enumerate(zip(blocks, pool.map(trace, blocks), strict=True), start=1):
            block.add_to(flat, values)
            if progress is not None:
                progress(done / len(blocks))
    flat *= (together / counts)[:, None]
    return jnp.asarray(flat.reshape(camera.height, camera.width, 3))


def _check_reach(layers: Layers, lens: AbstractLens) -> None:
    """Refuse a lens whose rays may pass surfaces that were left out as out of reach when peeling."""
    camera = layers.camera
    moves, peeled = float(lens.parallax(camera)), float(layers.lens.parallax(camera))
    if moves > peeled * (1 + 1e-5):
        raise ValueError(
            f"the lens moves rays by {moves:.4g} pixels per dioptre but the layers were peeled for"
            f" {peeled:.4g}; peel again with this lens"
        )
    leaves, margin = _strays(layers, lens), layers.grid.margin / layers.grid.supersampling
    if np.any(leaves > np.maximum(_strays(layers, layers.lens), margin) + 1e-3):
        raise ValueError(
            f"rays of the lens leave the frame by up to {leaves.max():.4g} pixels but the layers, peeled for"
            f" another focus, hold a margin of {margin:.4g}; peel again with this lens"
        )


def _strays(layers: Layers, lens: AbstractLens) -> np.ndarray:
    """How far in pixels rays stray from their film points, at disparities over the layers' range."""
    least, largest = (float(w) for w in layers.ranges.overall)
    if not largest > 0:
        return np.zeros(1)
    disparities = jnp.asarray(np.linspace(least, largest, 9).astype(layers.background.dtype))
    return np.asarray(_strays_at(lens, layers.camera, disparities))


@eqx.filter_jit
def _strays_at(lens: AbstractLens, camera: Camera, disparities: Float[Array, " n"]) -> Float[Array, " n"]:
    return jax.vmap(lambda w: lens.reach(camera, w))(disparities)


@eqx.filter_jit
def _ranges(
    layers: Layers, lens: AbstractLens
) -> tuple[Float[Array, " p"], Float[Array, " p"], Int[Array, " p"]]:
    """Disparity range and layer count of every pixel, row-major."""
    camera = layers.camera

    def one(index: Int[Array, ""]) -> tuple[Array, Array, Array]:
        film = jnp.stack([index % camera.width, index // camera.width]) + 0.5
        return disparity_range(layers, lens, film)

    return jax.vmap(one)(jnp.arange(camera.width * camera.height))


@eqx.filter_jit
def _trace_block(
    scene: _Scene,
    lens: AbstractLens,
    samples: RaySamples,
    pixels: Int[Array, " p"],
    first: Int[Array, " p"],
    least: Float[Array, " n"],
    largest: Float[Array, " n"],
    *,
    together: int,
    depth: int,
) -> Float[Array, "p 3"]:
    """Mean radiance of `together` rays of each of some `pixels`, those from `first` on."""
    grid = scene.grid
    column, row = pixels % grid.width, pixels // grid.width

    def of_pixel(
        column: Int[Array, ""],
        row: Int[Array, ""],
        first: Int[Array, ""],
        low: Float[Array, ""],
        high: Float[Array, ""],
    ) -> tuple[LensRay, Path, UInt[Array, " s"] | None]:
        corner = jnp.stack([column, row]).astype(low.dtype)
        offsets, pupils, chance = samples.of_pixel(column, row, first, together)

        def one(offset: Float[Array, "2"], pupil: Float[Array, "2"]) -> tuple[LensRay, Path]:
            ray = lens.ray(scene.camera, corner + offset, pupil)
            on_grid = LensRay(
                ray.a * grid.supersampling + grid.margin, ray.b * grid.supersampling, ray.weight
            )
            return on_grid, path_of(on_grid, low, high)

        return *jax.vmap(one)(offsets, pupils), chance

    rays, paths, chance = jax.vmap(of_pixel)(column, row, first, least[pixels], largest[pixels])
    paths, chance = jax.tree.map(lambda a: a.reshape(-1), (paths, chance))
    hits = first_hits(scene.volume, paths, chance, depth=depth).reshape(rays.weight.shape)

    def brought(ray: LensRay, hit: Int[Array, ""]) -> Float[Array, "3"]:
        return ray.weight * radiance_at(scene.surface, ray, hit)

    return jax.vmap(lambda ray, hit: jax.vmap(brought)(ray, hit).mean(axis=0))(rays, hits)
