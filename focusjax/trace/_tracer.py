"""Rays of chosen pixels through prepared layers, vmapped, in blocks of bounded memory."""

import concurrent.futures
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._parallel import CORES
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allot import FEWEST, contrast
from focusjax.trace._blocks import Block, make_blocks
from focusjax.trace._radiances import TracedScene, disparity_ranges, radiances, traced_scene
from focusjax.trace._reach import check_reach
from focusjax.trace._samples import RaySamples, ray_samples

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
        self.least, self.largest, depth = disparity_ranges(layers, lens, pixel_filter)
        self._depth = np.asarray(depth)
        self._scene = traced_scene(layers)

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
        opacity, wanted = self.layers.samples.opacity, self.pixel_filter
        samples = ray_samples(self.lens, levels, seed, with_chances=opacity is not None, pixel_filter=wanted)
        together = max(k for k in range(1, FEWEST + 1) if fewest % k == 0)
        at_once = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // together)
        blocks = make_blocks(counts // together, self._depth, self.layers.count, camera.width, at_once)
        sums = np.zeros((len(counts), 3), dtype=self.least.dtype)

        def trace(block: Block) -> np.ndarray:
            # The rays of the smaller counts come before those of a pixel's own.
            first = jnp.asarray(counts[block.pixels] - fewest + together * block.part)
            chosen = samples, jnp.asarray(block.pixels), first, self.least, self.largest
            traced = trace_block(self._scene, self.lens, *chosen, together=together, depth=block.depth)
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


@eqx.filter_jit
def trace_block(
    scene: TracedScene,
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
    values = block_radiances(
        scene, lens, samples, pixels, first, least, largest, together=together, depth=depth
    )
    return values.mean(axis=1)


def block_radiances(
    scene: TracedScene,
    lens: AbstractLens,
    samples: RaySamples,
    pixels: Int[Array, " p"],
    first: Int[Array, " p"],
    least: Float[Array, " n"],
    largest: Float[Array, " n"],
    *,
    together: int,
    depth: int,
) -> Float[Array, "p s 3"]:
    """What each ray of `trace_block` adds to its pixel."""
    width = scene.camera.width
    column, row = pixels % width, pixels // width
    offsets, pupil, chance = jax.vmap(samples.of_pixel, in_axes=(0, 0, 0, None))(column, row, first, together)
    film = jnp.stack([column, row], axis=-1).astype(offsets.dtype)[:, None] + offsets
    ends = least[pixels], largest[pixels]
    along, share = radiances(scene, lens, film, pupil, chance, *ends, depth=depth)
    return share[..., None] * along
