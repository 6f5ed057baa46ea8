"""Rays of chosen pixels through prepared layers, vmapped, in blocks of bounded memory."""

import functools
from collections.abc import Callable, Sequence
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import csr_array

from focusjax._arguments import require_kind
from focusjax._freed import return_freed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._aimed import Aimed
from focusjax.trace._allot import FEWEST, allot, allot_through, contrast, counts_for
from focusjax.trace._blocks import Blocks
from focusjax.trace._blur_classes import ONE_CLASS, BlurClasses, blur_classes
from focusjax.trace._class_sums import added_up, by_class, class_sums, told_apart
from focusjax.trace._devices import Device, Workforce
from focusjax.trace._focal_zone import focal_zone
from focusjax.trace._highlights import split_highlights
from focusjax.trace._known_light import KnownLight, known_light
from focusjax.trace._radiances import TracedScene, radiances, ranges_at_once, traced_scene
from focusjax.trace._reach import check_reach
from focusjax.trace._samples import RaySamples, ray_samples
from focusjax.trace._traced import Traced

_Shared: TypeAlias = tuple[
    TracedScene,
    AbstractLens,
    RaySamples,
    tuple[Float[Array, " p"], Float[Array, " p"]],
    BlurClasses,
]

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 23}


class Tracer:
    """Layers and a lens, ready for rays.

    Attributes:
        layers: what rays go through, but for small bright things that rays are aimed at.
        lens: where they come from.
        least: least disparity [p] that the rays of each pixel can meet, row-major.
        largest: largest disparity [p].
        pixel_filter: what the film points of a pixel's rays are spread by.
    """

    def __init__(
        self,
        layers: Layers,
        lens: AbstractLens,
        pixel_filter: str = "box",
        devices: Sequence[Device] | None = None,
    ) -> None:
        self._workforce = Workforce(devices)
        self.layers, highlights = split_highlights(layers, lens)
        self.lens, self.pixel_filter = lens, pixel_filter
        self.least, self.largest, depth = ranges_at_once(layers, lens, pixel_filter)
        self._depth = np.asarray(depth)
        return_freed(4 * self._depth.size)
        self._scene = traced_scene(self.layers)
        self._aimed = None if highlights is None else Aimed(highlights, self._scene, lens, pixel_filter)

    @property
    def aims(self) -> bool:
        """Whether some rays are aimed at small highlights, of whose light the others bring a part only."""
        return self._aimed is not None

    @property
    def aims_from(self) -> Bool[np.ndarray, " p"]:
        """From which pixels [p] rays are aimed."""
        found = np.zeros(len(self.least), dtype=bool)
        if self._aimed is not None:
            found[self._aimed.pixels] = True
        return found

    @functools.cached_property
    def known_light(self) -> KnownLight | None:
        """Mean weights of each pixel's rays; None where all pass alike."""
        return known_light(self.lens, self.layers.camera)

    @functools.cached_property
    def classes(self) -> BlurClasses:
        """By how blurred it is what rays meet can be told apart.

        Not where rays see highlights and mirrors for themselves: what these show is not blurred as they are.
        """
        if self.layers.samples.gloss is not None:
            return ONE_CLASS
        return blur_classes(focal_zone(self.lens, self.layers.camera), self.largest, self.least)

    @functools.cached_property
    def contrast(self) -> Float[np.ndarray, " p"]:
        """Variance [p] of what the rays of each pixel may meet; see `_allot`."""
        found = contrast(self.layers, self.lens, self.least, self.largest, self.pixel_filter)
        return_freed(4 * found.size)
        return found

    def counts(self, rays: int) -> Int[np.ndarray, " p"]:
        """Rays [p] of each pixel, those that are aimed apart; with them `rays` on the average."""
        aimed = 0.0
        if self._aimed is not None:
            aimed = self._aimed.rays(rays) * len(self._aimed.pixels) / len(self.contrast)
        return self.allotted(max(rays - aimed, FEWEST))

    def allotted(self, rays: float, wanted: Bool[np.ndarray, " p"] | None = None) -> Int[np.ndarray, " n"]:
        """Rays of each of all pixels, or of the wanted ones, by what differs there; `rays` on the average."""
        chosen = slice(None) if wanted is None else wanted
        if self.known_light is None:
            return allot(self.contrast[chosen], rays)
        light = np.asarray(self.known_light.share[:, 1])
        return allot_through(self.contrast[chosen], light[chosen], rays)

    def trace(
        self,
        counts: Int[np.ndarray, " p"],
        rays: int,
        seed: int,
        progress: Callable[[float], None] | None = None,
        *,
        classes: BlurClasses | None = None,
        independent: bool = False,
    ) -> Traced:
        """As many rays of each pixel as `counts` says: 0 (nothing is traced), or others.

        Args:
            counts: all alike, or those of `counts` for some of the pixels.
            rays: the mean that they were made for.
            seed: chooses the rays.
            progress: is told the share done.
            classes: by which what rays bring is told apart, for the picture to be smoothed: its own, or
                those of a picture that this is a part of. Not at all if None.
            independent: of pictures of other seeds, for their differences to tell of noise.
        """
        levels = _levels(counts, rays)
        blocks, together = self._blocks(counts, rays)
        samples = ray_samples(
            self.lens,
            levels,
            seed,
            with_chances=self.layers.samples.opacity is not None,
            pixel_filter=self.pixel_filter,
            independent=independent,
        )
        classes = ONE_CLASS if classes is None else classes

        def trace(number: int, shared: _Shared) -> tuple[Int[np.ndarray, " d"], csr_array]:
            block = blocks[number]
            # The rays of the smaller counts come before those of a pixel's own.
            first = jnp.asarray(counts[block.pixels] - levels[0] + together * block.part)
            scene, lens, samples, ends, classes = shared
            chosen = samples, jnp.asarray(block.pixels), first, jnp.asarray(block.place), *ends, classes
            found = trace_block(scene, lens, *chosen, together=together, depth=block.depth)
            sums = np.asarray(found)[: len(block.places)]
            return block.places, csr_array(sums / counts[block.places, None].astype(sums.dtype))

        shared = self._scene, self.lens, samples, (self.least, self.largest), classes
        found = []
        for part, done in self._workforce.each(trace, len(blocks), shared):
            found.append(part)
            if len(found) == blocks.kinds:
                # Their programs are compiled, which leaves much behind.
                return_freed(4 * len(counts))
            if progress is not None:
                progress(done)
        sums = added_up(found, (len(counts), told_apart(self.lens, classes)), self.least.dtype)
        del found
        return_freed(sums.nnz)
        # Of a pixel other processes may have traced a part.
        apart, over = by_class(self._workforce.total_of_sparse(sums))
        return Traced(
            sums=apart,
            over=over,
            aimed=self._by_aimed(counts, rays, seed),
            least=classes.least,
            width=self.layers.camera.width,
            rays=rays,
            known=self.known_light,
        )

    def work(self, counts: Int[np.ndarray, " p"], rays: int) -> int:
        """How many rays `trace` follows, with those that only fill blocks; its time goes about as that."""
        blocks, together = self._blocks(counts, rays)
        return len(blocks) * blocks.size * together

    def _blocks(self, counts: Int[np.ndarray, " p"], rays: int) -> tuple[Blocks, int]:
        """The work that `counts` make, and how many rays of a pixel are traced together."""
        fewest = _levels(counts, rays)[0]
        together = max(k for k in range(1, FEWEST + 1) if fewest % k == 0)
        at_once = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // together)
        width = self.layers.camera.width
        return Blocks(counts // together, self._depth, self.layers.count, width, at_once), together

    def _by_aimed(self, counts: Int[np.ndarray, " p"], rays: int, seed: int) -> np.ndarray | float:
        """What rays aimed at highlights bring to the pixels that are traced."""
        if self._aimed is None:
            return 0.0
        found = np.zeros((len(counts), 3), dtype=self.least.dtype)
        ends = self.least, self.largest
        self._aimed.add_to(found, counts > 0, ends, self._aimed.rays(rays), seed, self._workforce)
        return self._workforce.total(found)


def _levels(counts: Int[np.ndarray, " p"], rays: int) -> list[int]:
    """The numbers of rays that pixels may get."""
    return [rays] if np.isin(counts, (0, rays)).all() else counts_for(rays)


def ready_tracer(
    layers: Layers,
    lens: AbstractLens,
    pixel_filter: str | None,
    devices: Sequence[Device] | None = None,
) -> Tracer:
    """The tracer of a lens and a filter (that of the layers if None), if the layers hold all of its rays.

    Raises:
        ValueError: they do not, or there is no such filter; devices that cannot share the work.
    """
    usage = "(layers, lens)"
    require_kind(layers, Layers, usage, "`peel` and `decompose` make them", "layers")
    require_kind(lens, AbstractLens, usage, "`thin_lens` makes one, as others do", "lens")
    chosen = layers.pixel_filter if pixel_filter is None else pixel_filter
    check_reach(layers, lens, chosen)
    return Tracer(layers, lens, chosen, devices)


@eqx.filter_jit
def trace_block(
    scene: TracedScene,
    lens: AbstractLens,
    samples: RaySamples,
    pixels: Int[Array, " p"],
    first: Int[Array, " p"],
    place: Int[Array, " p"],
    least: Float[Array, " n"],
    largest: Float[Array, " n"],
    classes: BlurClasses,
    *,
    together: int,
    depth: int,
) -> Float[Array, "p c"]:
    """Sums over `together` rays of each of some `pixels`, those from `first` on, of what they bring.

    These are `class_sums`, a row each.
    """
    count, in_each = len(pixels), bool(lens.channels())

    def seen(lens: AbstractLens) -> Float[Array, "p k c"]:
        met = block_radiances(
            scene, lens, samples, pixels, first, least, largest, together=together, depth=depth
        )
        return class_sums(*met, pixels, place, classes, in_each=in_each)

    mixed = in_colour(seen, lens) if in_each else seen(lens)
    return mixed.reshape(count, -1)


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
) -> tuple[Float[Array, "p s 3"], Float[Array, "p s"], Float[Array, "p s"]]:
    """What `radiances` tells of each ray of `trace_block`, by one lens's light."""
    width = scene.camera.width
    column, row = pixels % width, pixels // width
    offsets, pupil, chance = jax.vmap(samples.of_pixel, in_axes=(0, 0, 0, None))(column, row, first, together)
    film = jnp.stack([column, row], axis=-1).astype(offsets.dtype)[:, None] + offsets
    return radiances(scene, lens, film, pupil, chance, least[pixels], largest[pixels], depth=depth)
