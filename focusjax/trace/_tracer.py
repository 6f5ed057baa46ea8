"""Rays of chosen pixels through prepared layers, vmapped, in blocks of bounded memory."""

import concurrent.futures
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._parallel import CORES
from focusjax.geometry import Camera, LensRay
from focusjax.layers import Grid, Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allot import FEWEST, contrast
from focusjax.trace._blocks import Block, make_blocks
from focusjax.trace._colour import Surface, radiance_at, surface_of
from focusjax.trace._march import first_hits
from focusjax.trace._ranges import disparity_range
from focusjax.trace._reach import check_reach
from focusjax.trace._samples import RaySamples, ray_samples
from focusjax.trace._walk import Path, Volume, make_volume, path_of

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 23}


class Tracer:
    """Layers and a lens, ready for rays.

    Attributes:
        layers: what rays go through.
        lens: where they come from.
        least: least disparity [p] that the rays of each pixel can meet, row-major.
        largest: largest disparity [p].
        pixel_filter: what the film points of a pixel's rays are spread by.
    """

    def __init__(self, layers: Layers, lens: AbstractLens, pixel_filter: str = "box") -> None:
        self.layers, self.lens, self.pixel_filter = layers, lens, pixel_filter
        self.least, self.largest, depth = _ranges(layers, lens, pixel_filter)
        self._depth = np.asarray(depth)
        self._scene = _Scene(
            volume=make_volume(layers.cells, layers.disparity_scale, layers.opacity),
            surface=surface_of(layers),
            camera=layers.camera,
            grid=layers.grid,
        )

    def contrast(self) -> Float[np.ndarray, " p"]:
        """Variance [p] of what the rays of each pixel may meet; see `_allot`."""
        return contrast(self.layers, self.lens, self.least, self.largest, self.pixel_filter)

    def means(
        self,
        counts: Int[np.ndarray, " p"],
        levels: Sequence[int],
        seed: int,
        progress: Callable[[float], None] | None = None,
    ) -> Float[np.ndarray, "p 3"]:
        """Mean radiance of each pixel over as many rays as `counts` says: 0, or one of `levels`.

        Levels increase from one to the next by a factor of two. `progress` is told the share done.
        """
        camera, fewest = self.layers.camera, levels[0]
        chances = self.layers.samples.opacity is not None
        samples = ray_samples(self.lens, levels, seed, chances=chances, pixel_filter=self.pixel_filter)
        together = max(k for k in range(1, FEWEST + 1) if fewest % k == 0)
        at_once = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // together)
        blocks = make_blocks(counts // together, self._depth, self.layers.count, camera.width, at_once)
        sums = np.zeros((len(counts), 3), dtype=self.least.dtype)

        def trace(block: Block) -> np.ndarray:
            # The rays of the smaller counts come before those of a pixel's own.
            first = jnp.asarray(counts[block.pixels] - fewest + together * block.part)
            chosen = samples, jnp.asarray(block.pixels), first, self.least, self.largest
            traced = _trace_block(self._scene, self.lens, *chosen, together=together, depth=block.depth)
            return np.asarray(traced)

        # XLA runs one block on about one core, so a CPU is given a block per core at a time.
        workers = CORES if jax.default_backend() == "cpu" else 1
        with concurrent.futures.ThreadPoolExecutor(workers) as pool:
            traced = zip(blocks, pool.map(trace, blocks), strict=True)
            for done, (block, values) in enumerate(traced, start=1):
                block.add_to(sums, values)
                if progress is not None:
                    progress(done / len(blocks))
        return sums * (together / np.maximum(counts, 1))[:, None].astype(sums.dtype)


def ready_tracer(layers: Layers, lens: AbstractLens, pixel_filter: str | None) -> Tracer:
    """The tracer of a lens and a filter (that of the layers if None), if the layers hold all of its rays.

    Raises:
        ValueError: they do not, or there is no such filter.
    """
    chosen = layers.pixel_filter if pixel_filter is None else pixel_filter
    check_reach(layers, lens, chosen)
    return Tracer(layers, lens, chosen)


class _Scene(eqx.Module):
    """What one pixel needs to know."""

    volume: Volume
    surface: Surface
    camera: Camera
    grid: Grid = eqx.field(static=True)


@eqx.filter_jit
def _ranges(
    layers: Layers, lens: AbstractLens, pixel_filter: str
) -> tuple[Float[Array, " p"], Float[Array, " p"], Int[Array, " p"]]:
    """Disparity range and layer count of every pixel, row-major."""
    camera = layers.camera

    def one(index: Int[Array, ""]) -> tuple[Array, Array, Array]:
        film = jnp.stack([index % camera.width, index // camera.width]) + 0.5
        return disparity_range(layers, lens, film, pixel_filter)

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
