"""Pictures of a few pixels only, from which the error of a whole one is estimated.

One compiled program serves every number of rays: the number is traced, and the list of ray groups is as
long as the largest one needs; of it, only what is used is traced. Pixels come as a list, in which small
windows may come first: square parts of the picture, each denoised as if it were a picture.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt

from focusjax._programs import jit
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._accumulate import PixelSums, seen_by, summed
from focusjax.trace._allocate import FEWEST, allocated, contrast, counts_for, least_through
from focusjax.trace._coc_bins import CocBins
from focusjax.trace._emitters import Emitters, split_emitters
from focusjax.trace._groups import SomeGroups, groups_of
from focusjax.trace._known_light import KnownLight, known_light
from focusjax.trace._picture import RenderSettings, coc_bins, developed
from focusjax.trace._radiances import Seen, traced_scene
from focusjax.trace._ranges import DisparityRanges, disparity_ranges
from focusjax.trace._samples import ray_samples

_TOGETHER = 4
_ROW = 32
"""Pixels in each row of the list, in the order of which its rays are traced."""
_TILE = 16
"""Edge in pixels of the tile of samples, which repeats."""


class Prepared(eqx.Module):
    """What rays of all numbers have in common.

    Attributes:
        layers: without emitters that have rays of their own.
        emitters: these; None where there are none.
        ranges: disparities that rays can meet.
        variance: of what the rays of each pixel may meet [p].
        known: light that gets through the lens; None where all rays pass alike.
        bins: circle-of-confusion bins.
    """

    layers: Layers
    emitters: Emitters | None
    ranges: DisparityRanges
    variance: Float[Array, " p"]
    known: KnownLight | None
    bins: CocBins


@dataclasses.dataclass(frozen=True)
class Windows:
    """Square parts of the picture at the front of a list of pixels.

    Attributes:
        count: how many.
        height: pixels of each from top to bottom.
        width: pixels of each from left to right.
    """

    count: int
    height: int
    width: int


NO_WINDOWS = Windows(0, 0, 0)


@jit
def prepared(layers: Layers, lens: AbstractLens, *, settings: RenderSettings) -> Prepared:
    """What rays of all numbers have in common."""
    camera, pixel_filter = layers.camera, settings.pixel_filter
    emitters = None
    if settings.emitters:
        layers, emitters = split_emitters(layers, lens)
    ranges = disparity_ranges(layers, lens, pixel_filter)
    row, column = jnp.divmod(jnp.arange(camera.width * camera.height, dtype=jnp.int32), camera.width)
    variance = contrast(layers, lens, ranges, pixel_filter, smooth=settings.smooth)
    variance = variance[ranges.square(column, row)]
    bins = coc_bins(layers, lens) if settings.smooth else CocBins(None)
    return Prepared(layers, emitters, ranges, variance, known_light(lens, camera), bins)


@jit
def some_pixels(
    lens: AbstractLens,
    ready: Prepared,
    pixels: Int[Array, " n"],
    rays: Int[Array, ""],
    seeds: UInt[Array, " k"],
    *,
    most_rays: int,
    pixel_filter: str,
    windows: Windows = NO_WINDOWS,
) -> tuple[Float[Array, "k n 3"], Float[Array, "k m 3"], Int[Array, ""]]:
    """Plain means over the rays of chosen pixels, denoised ones in windows, and the rays traced per seed.

    All are without the light of emitters, which `light_at_once` gives. Each of `seeds` makes an
    independent picture.

    Args:
        lens: as for `render`.
        ready: by `prepared`.
        pixels: row-major numbers [n], those of windows first; n is a multiple of 32.
        rays: per pixel on the average over the whole picture, 4 to `most_rays`.
        seeds: of the rays.
        most_rays: the largest number (static).
        pixel_filter: as for `render`.
        windows: the parts of the picture that the first of `pixels` are (static).
    """
    layers = ready.layers
    least = None if ready.known is None else least_through(ready.known.share[:, 1], rays)
    count = allocated(ready.variance, rays, rays, least=least)[pixels]
    levels = counts_for(most_rays)
    width = layers.camera.width
    # No more groups than if all of the pixels had the mean of the largest number, twice.
    most = 2 * len(pixels) * most_rays // _TOGETHER
    groups = groups_of(count, _ROW, len(pixels) // _ROW, _TOGETHER, most=most, nested=FEWEST)
    scene = traced_scene(layers)
    bins = jax.tree.map(lambda plane: plane[pixels], ready.bins)
    known = jax.tree.map(lambda plane: plane[pixels], ready.known)
    inside = windows.count * windows.height * windows.width

    def of_seed(seed: UInt[Array, ""]) -> tuple[Float[Array, "n 3"], Float[Array, "m 3"]]:
        samples = ray_samples(
            lens,
            levels,
            seed,
            with_chances=layers.samples.opacity is not None,
            pixel_filter=pixel_filter,
            edge=_TILE,
        )

        def seen(some: SomeGroups, lens: AbstractLens) -> Seen:
            of_picture = pixels[jnp.minimum(some.pixel, len(pixels) - 1)]
            some = dataclasses.replace(some, pixel=of_picture)
            return seen_by(some, scene, lens, samples, ready.ranges)

        sums = summed(seen, lens, groups, bins, len(pixels))
        plain = PixelSums(sums.binned.sum(axis=0, keepdims=True), sums.over)
        raw = developed(plain, width, CocBins(None), rays, known)
        if not inside:
            return raw, raw[:0]

        def denoised_window(values: tuple[Array, Array, KnownLight | None]) -> Float[Array, "_ 3"]:
            binned, over, light = values
            sums = PixelSums(jnp.moveaxis(binned, 0, 1), over)
            return developed(sums, windows.width, ready.bins, rays, light)

        each = jax.tree.map(
            lambda plane: plane[:inside].reshape(windows.count, -1, *plane.shape[1:]),
            (jnp.moveaxis(sums.binned, 1, 0), sums.over, known),
        )
        return raw, jax.lax.map(denoised_window, each).reshape(-1, 3)

    raw, smooth = jax.lax.map(of_seed, seeds)
    return raw, smooth, _TOGETHER * groups.used
