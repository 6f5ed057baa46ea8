"""The picture: rays of every pixel, vmapped, in blocks of bounded memory."""

import concurrent.futures
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._counts import require_counts
from focusjax._parallel import CORES
from focusjax.geometry import Camera, LensRay
from focusjax.layers import Grid, Layers
from focusjax.lens import AbstractLens
from focusjax.trace._colour import Surface, radiance_at, surface_of
from focusjax.trace._march import first_hits
from focusjax.trace._ranges import disparity_range
from focusjax.trace._samples import RaySamples, ray_samples, z_order
from focusjax.trace._walk import Path, Volume, make_volume, path_of

_SAMPLES_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 23}


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
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Float[Array, "h w 3"]:
    """The picture that `lens` forms of `layers`: linear radiance, mean over `rays` rays per pixel.

    Args:
        layers: peeled for this lens or for one whose rays go farther.
        lens: any lens.
        rays: rays per pixel; each has its own place in the pixel and on the lens.
        seed: chooses the rays; the same seed gives the same picture.
        progress: called with the share done, 0 to 1, now and then.

    Raises:
        ValueError: no rays, or a lens whose rays leave what the layers were peeled for.
    """
    require_counts(rays=rays)
    _check_reach(layers, lens)
    grid, camera = layers.grid, layers.camera
    samples = ray_samples(lens, rays, seed, chances=layers.samples.opacity is not None)
    scene = _Scene(
        volume=make_volume(layers.cells, layers.disparity_scale, layers.opacity),
        surface=surface_of(layers),
        camera=camera,
        grid=grid,
    )
    least, largest, depth = _ranges(layers, lens)
    work = np.asarray((largest - least) * lens.parallax(camera))
    together = _rays_together(rays)
    at_once = _SAMPLES_AT_ONCE.get(jax.default_backend(), 1 << 20)
    blocks = _blocks(work, np.asarray(depth), max(1, at_once // together), layers.count, camera.width)
    flat = np.zeros((camera.width * camera.height, 3), dtype=least.dtype)

    def trace(block: tuple[np.ndarray, int]) -> tuple[np.ndarray, np.ndarray]:
        pixels, variant = block
        ids = jnp.asarray(pixels)
        traced = _trace_block(scene, lens, samples, ids, least, largest, together=together, depth=variant)
        return pixels, np.asarray(traced)

    # XLA runs one block on about one core, so a CPU is given a block per core at a time.
    workers = CORES if jax.default_backend() == "cpu" else 1
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        for done, (pixels, values) in enumerate(pool.map(trace, blocks), start=1):
            flat[pixels] = values
            if progress is not None:
                progress(done / len(blocks))
    return jnp.asarray(flat.reshape(camera.height, camera.width, 3))


def _rays_together(rays: int) -> int:
    """The largest share of a pixel's rays, at most an eighth or four, that divides them."""
    most = max(4, rays // 8)
    return max(k for k in range(1, min(most, rays) + 1) if rays % k == 0)


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


def _blocks(
    work: np.ndarray, depth: np.ndarray, block: int, most_layers: int, columns: int
) -> list[tuple[np.ndarray, int]]:
    """Pixels in blocks of like work, the last one repeating a pixel to be full, and layers to test.

    Within a fifth of an octave of work pixels stay in Z-order, so that a block reads few places of the
    layers.
    """
    variants = np.unique(np.minimum([4, 8, 16, most_layers], most_layers))
    level = np.searchsorted(variants, np.maximum(depth, 1))
    row, column = np.divmod(np.arange(len(work)), columns)
    order = np.lexsort((z_order(column, row), np.ceil(5 * np.log2(1 + work)), level))
    block = min(block, len(order))
    out = []
    for start in range(0, len(order), block):
        pixels = order[start : start + block]
        pixels = np.concatenate([pixels, np.full(block - len(pixels), pixels[-1])])
        out.append((pixels, int(variants[level[pixels].max()])))
    # One block of each kind first, so that their programs are compiled side by side.
    kinds = [variant for _, variant in out]
    first = sorted({kinds.index(variant) for variant in kinds})
    return [out[k] for k in first] + [block for k, block in enumerate(out) if k not in first]


@eqx.filter_jit
def _trace_block(
    scene: _Scene,
    lens: AbstractLens,
    samples: RaySamples,
    pixels: Int[Array, " p"],
    least: Float[Array, " n"],
    largest: Float[Array, " n"],
    *,
    together: int,
    depth: int,
) -> Float[Array, "p 3"]:
    """Mean radiance of some `pixels`, `together` rays of each at a time."""
    grid = scene.grid
    least, largest = least[pixels], largest[pixels]
    column, row = pixels % grid.width, pixels // grid.width
    corner = jnp.stack([column, row], axis=1).astype(least.dtype)

    def of_pixel(
        corner: Float[Array, "2"], low: Array, high: Array, offsets: Array, pupils: Array
    ) -> tuple[LensRay, Path]:
        def one(offset: Float[Array, "2"], pupil: Float[Array, "2"]) -> tuple[LensRay, Path]:
            ray = lens.ray(scene.camera, corner + offset, pupil)
            on_grid = LensRay(
                ray.a * grid.supersampling + grid.margin, ray.b * grid.supersampling, ray.weight
            )
            return on_grid, path_of(on_grid, low, high)

        return jax.vmap(one)(offsets, pupils)

    def some_rays(first: Int[Array, ""]) -> Float[Array, "p 3"]:
        starts = jax.vmap(lambda x, y: samples.of_pixel(x, y, first, together))(column, row)
        offsets, pupils, chance = starts
        rays, paths = jax.vmap(of_pixel)(corner, least, largest, offsets, pupils)
        paths, chance = jax.tree.map(lambda a: a.reshape(-1), (paths, chance))
        hits = first_hits(scene.volume, paths, chance, depth=depth).reshape(rays.weight.shape)

        def brought(ray: LensRay, hit: Int[Array, ""]) -> Float[Array, "3"]:
            return ray.weight * radiance_at(scene.surface, ray, hit)

        return jax.vmap(lambda ray, hit: jax.vmap(brought)(ray, hit).sum(axis=0))(rays, hits)

    rays = samples.pupil.shape[1]
    return jax.lax.map(some_rays, jnp.arange(0, rays, together)).sum(axis=0) / rays
