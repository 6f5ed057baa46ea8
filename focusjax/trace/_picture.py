"""The picture and its derivative: one function of arrays.

The picture is that of `render`'s rays. Its derivative by the lens is that of the converged picture (see
`focusjax.trace._motion`), estimated by rays of its own: the gradient of a loss multiplies the picture's error
by the derivative's, and noise must not meet itself in it. The derivative by radiance, in which the picture is
linear but for what is cut off at black and white, is that of its own rays.
"""

import dataclasses
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, UInt

from focusjax._arguments import ArgumentError
from focusjax._programs import jit
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._accumulate import PixelSums, no_sums, traced_sums
from focusjax.trace._allocate import FEWEST, contrast
from focusjax.trace._bands import Bands, Window, bands_of, picture_in_bands
from focusjax.trace._coc_bins import CocBins, focal_zone
from focusjax.trace._denoise import denoised, taken_in
from focusjax.trace._devices import rays_at_once
from focusjax.trace._emitter_pairs import emitter_light
from focusjax.trace._emitters import Emitters, split_emitters
from focusjax.trace._flux import Rays, Still, picture_flow
from focusjax.trace._groups import RayCounts, adaptive_counts, even_counts
from focusjax.trace._known_light import KnownLight, evened, known_light
from focusjax.trace._radiances import TracedScene, traced_scene
from focusjax.trace._ranges import DisparityRanges, disparity_ranges
from focusjax.trace._samples import RaySamples, ray_samples
from focusjax.trace._sobol import stirred

_T = TypeVar("_T")

_DERIVATIVE = 1 << 20
"""Number of the seed's stream for rays of derivatives."""
_MOST_RAYS = 1 << 24
"""Of a pixel: their table is 16 times as long."""
MOST_GROUPS = 2_000_000_000
"""Below 2^31, in which they are counted, with room for rounding up."""


@dataclasses.dataclass(frozen=True)
class RenderSettings:
    """What a picture is made with, known when its program is compiled.

    Attributes:
        rays: per pixel on the average.
        derivative_rays: per border between pixels, rim of the aperture and pixel, for derivatives.
        even: whether every pixel has as many rays.
        smooth: whether what is blurred is denoised.
        pixel_filter: "box", "tent" or "gaussian".
        emitters: whether anything may be bright enough for rays of its own.
        mesh: devices that share the picture; None for the default one.
    """

    rays: int
    derivative_rays: int
    even: bool
    smooth: bool
    pixel_filter: str
    emitters: bool
    mesh: Mesh | None = None


def most_rays(pixels: int, together: int = 1) -> int:
    """The most rays per pixel of a picture of so many pixels, traced in groups of `together`."""
    return min(_MOST_RAYS, together * (MOST_GROUPS // pixels))


@jit
def picture(
    layers: Layers, lens: AbstractLens, seed: UInt[Array, ""], *, settings: RenderSettings
) -> Float[Array, "h w 3"]:
    """Linear radiance, for JAX to differentiate by the lens and by the layers' radiance."""
    fixed = jax.tree.map(jax.lax.stop_gradient, eqx.filter(layers, eqx.is_array))
    fixed = eqx.combine(fixed, layers)
    look = layers.samples.radiance, layers.background
    means = _means(look, lens, fixed, seed, settings=settings)
    return means.reshape(layers.camera.height, layers.camera.width, 3)


@eqx.filter_custom_jvp
def _means(
    look: tuple[Array, Array],
    lens: AbstractLens,
    layers: Layers,
    seed: UInt[Array, ""],
    *,
    settings: RenderSettings,
) -> Float[Array, "p 3"]:
    """The picture, row-major, of layers that look so."""
    return traced_picture(_looking(layers, look), lens, seed, settings)


@_means.def_jvp
def _means_jvp(
    primals: Any, tangents: Any, *, settings: RenderSettings
) -> tuple[Float[Array, "p 3"], Float[Array, "p 3"]]:
    look, lens, layers, seed = primals
    look_moves, lens_moves, _, _ = tangents
    means = _means(look, lens, layers, seed, settings=settings)
    change = jnp.zeros_like(means)
    lens = _differentiated_once(lens)
    if jax.tree.leaves(look_moves):

        def seen(look: tuple[Array, Array]) -> Float[Array, "p 3"]:
            return traced_picture(_looking(layers, look), lens, seed, settings)

        change += eqx.filter_jvp(seen, (look,), (look_moves,))[1]
    if jax.tree.leaves(lens_moves):
        still = _still(
            _looking(layers, _differentiated_once(look)), lens, stirred(seed, _DERIVATIVE), settings
        )
        flow = eqx.filter_jvp(lambda new: picture_flow(still, new), (lens,), (lens_moves,))[1]
        change += flow.reshape(-1, 3)
    return means, change


def _differentiated_once(tree: _T) -> _T:
    """The same arrays, in a derivative that is estimated: its own derivative would be another thing's."""
    return jax.tree.map(lambda leaf: _once(leaf) if eqx.is_inexact_array(leaf) else leaf, tree)


@jax.custom_jvp
def _once(array: Array) -> Array:
    """An array, of which derivatives are refused."""
    return array


@_once.defjvp
def _once_jvp(primals: Any, tangents: Any) -> Any:
    raise ArgumentError(
        "second derivatives of a picture by its lens cannot be estimated from its rays, as the first are;"
        " take differences of first derivatives, over a step that is not small, with many rays",
        "lens",
    )


def _looking(layers: Layers, look: tuple[Array, Array]) -> Layers:
    """The layers with other radiances of samples and background."""
    samples = dataclasses.replace(layers.samples, radiance=look[0])
    return dataclasses.replace(layers, samples=samples, background=look[1])


def traced_picture(
    layers: Layers, lens: AbstractLens, seed: UInt[Array, ""], settings: RenderSettings
) -> Float[Array, "p 3"]:
    """The picture, row-major."""
    emitters = None
    if settings.emitters:
        layers, emitters = split_emitters(layers, lens)
    known = known_light(lens, layers.camera)
    bins = coc_bins(layers, lens) if settings.smooth else CocBins(None)
    camera, reach = layers.camera, taken_in(bins.least, settings.rays)
    bands = bands_of(camera.width, camera.height, reach) if settings.mesh is None else None
    if bands is not None:
        means = _in_bands(layers, lens, seed, settings, bins, known, bands)
    else:
        sums = picture_sums(layers, lens, seed, settings, bins, known)
        means = developed(sums, camera.width, bins, settings.rays, known)
    return means if emitters is None else means + light_of(emitters, layers, lens, seed, settings)


def light_of(
    emitters: Emitters, layers: Layers, lens: AbstractLens, seed: UInt[Array, ""], settings: RenderSettings
) -> Float[Array, "p 3"]:
    """The light that each pixel gets from emitters that were split off `layers`."""
    ranges = disparity_ranges(layers, lens, settings.pixel_filter)
    rays, pixel_filter = settings.rays, settings.pixel_filter
    scene = traced_scene(layers)
    return emitter_light(scene, lens, emitters, ranges, seed, rays=rays, pixel_filter=pixel_filter)


light_at_once = jit(light_of)
"""The same by a program of its own."""


def _in_bands(
    layers: Layers,
    lens: AbstractLens,
    seed: UInt[Array, ""],
    settings: RenderSettings,
    bins: CocBins,
    known: KnownLight | None,
    bands: Bands,
) -> Float[Array, "p 3"]:
    """The picture of layers without emitters, of which the sums of few rows are held at a time."""
    trace = _tracing(layers, lens, seed, settings, known)
    width, pixels = layers.camera.width, bands.window * layers.camera.width

    def traced(window: Window, sums: PixelSums) -> PixelSums:
        count = jnp.where(window.is_new(pixels), window.of(trace.counts.of_pixel), 0)
        groups = trace.counts.groups(count, width, bands.window)
        begin = window.first * width
        return traced_sums(
            trace.scene, lens, trace.samples, groups, trace.ranges, window.of(bins), begin=begin, onto=sums
        )

    def of_window(window: Window, sums: PixelSums) -> Float[Array, "n 3"]:
        return developed(sums, width, bins, settings.rays, window.of(known))

    return picture_in_bands(
        bands, no_sums(len(bins.least), pixels, lens, trace.counts.of_pixel), traced, of_window
    )


def picture_sums(
    layers: Layers,
    lens: AbstractLens,
    seed: UInt[Array, ""],
    settings: RenderSettings,
    bins: CocBins,
    known: KnownLight | None,
    wanted: Bool[Array, " p"] | None = None,
) -> PixelSums:
    """The sums of all pixels, or of those that are `wanted` as they are among all; 0 in the others."""
    trace = _tracing(layers, lens, seed, settings, known)
    count = trace.counts.of_pixel
    if wanted is not None:
        count = jnp.where(wanted, count, 0)
    groups = trace.counts.groups(count, layers.camera.width, layers.camera.height)
    return traced_sums(trace.scene, lens, trace.samples, groups, trace.ranges, bins, settings.mesh)


class _Tracing(eqx.Module):
    """What rays of a picture go through, which they are, and how many of each pixel."""

    scene: TracedScene
    samples: RaySamples
    ranges: DisparityRanges
    counts: RayCounts


def _tracing(
    layers: Layers,
    lens: AbstractLens,
    seed: UInt[Array, ""],
    settings: RenderSettings,
    known: KnownLight | None,
) -> _Tracing:
    """All that is the same for every part of a picture."""
    fixed = jax.lax.stop_gradient(layers)
    ranges = disparity_ranges(layers, lens, settings.pixel_filter)
    if settings.even or settings.rays < FEWEST:
        counts = even_counts(layers.camera, settings.rays)
    else:
        variance = contrast(fixed, lens, ranges, settings.pixel_filter, smooth=settings.smooth)
        counts = adaptive_counts(variance, layers.camera, ranges, known, settings.rays)
    samples = ray_samples(
        lens,
        counts.numbers,
        seed,
        with_chances=layers.samples.opacity is not None,
        pixel_filter=settings.pixel_filter,
    )
    return _Tracing(traced_scene(layers), samples, ranges, counts)


def coc_bins(layers: Layers, lens: AbstractLens) -> CocBins:
    """The bins of a picture.

    One where rays see highlights and mirrors for themselves: what these show is not blurred as they are.
    """
    return CocBins(None if layers.samples.gloss is not None else focal_zone(lens, layers.camera))


def developed(
    sums: PixelSums, width: int, bins: CocBins, rays: float | Array, known: KnownLight | None
) -> Float[Array, "p 3"]:
    """Radiance of each pixel from the sums over its rays, denoised if there are several bins.

    `width` is that of a row of pixels; `rays` may be traced.
    """
    light = sums.light()
    share = light if known is None else known.of(light)
    over = sums.over if known is None else evened(sums.over, light, known)
    if len(bins.least) == 1:
        brought = sums.brought()
        return (brought if known is None else evened(brought, light, known)) + over
    return denoised(sums, width, bins.least, rays) * share + over


def _still(layers: Layers, lens: AbstractLens, seed: UInt[Array, ""], settings: RenderSettings) -> Still:
    """What derivatives are made of: the scene, and the mean radiance of rays like those through the rim."""
    camera, scene, number = layers.camera, traced_scene(layers), settings.derivative_rays
    ranges = disparity_ranges(layers, lens)
    samples = ray_samples(lens, (number,), seed, with_chances=layers.samples.opacity is not None)
    counts = even_counts(camera, number)
    groups = counts.groups(counts.of_pixel, camera.width, camera.height)
    sums = traced_sums(scene, lens, samples, groups, ranges, CocBins(None))
    light, brought = sums.light(), sums.brought() + sums.over
    radiance = jnp.where(light > 0, brought / jnp.where(light > 0, light, 1.0), 0.0)
    film = jnp.stack(samples.place, axis=-1).reshape(-1, number, 2)
    least, largest = ranges.of_pixels(camera.width, camera.height)
    return Still(scene, lens, least, largest, radiance, film, Rays(number, seed, rays_at_once()))
