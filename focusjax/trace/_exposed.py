"""Pictures of bodies that move: the rays of some pixels, span after span of the shutter's time."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._accumulate import PixelSums, starts_of, summed
from focusjax.trace._coc_bins import CocBins, focal_zone
from focusjax.trace._devices import rays_at_once
from focusjax.trace._emitters import split_at_once
from focusjax.trace._groups import SomeGroups
from focusjax.trace._known_light import known_light
from focusjax.trace._moving import MovingLayers, seen_in_motion
from focusjax.trace._moving_emitters import moving_light
from focusjax.trace._picture import MOST_GROUPS, RenderSettings, developed, light_at_once, picture_sums
from focusjax.trace._radiances import Seen
from focusjax.trace._render import render_settings, seed_of
from focusjax.trace._samples import RaySamples
from focusjax.trace._sobol import stirred
from focusjax.trace._timed import RowShares, Timing, row_shares, timed_groups, timed_samples

_samples = jit(timed_samples)
_TOGETHER = 4
"""At most so many rays of a pixel, one after the other in time, that look up one range of disparities."""
_FEWEST_GROUPS = 1 << 12
"""Room for groups of a program that is compiled for few."""
_TIMED = 1 << 21
"""Number of the seed's stream for rays that have times."""


@dataclasses.dataclass(frozen=True)
class Span:
    """Times from `begin` to `end` with the bodies' layers for them, the backdrop first."""

    begin: float
    end: float
    bodies: tuple[MovingLayers, ...]


def exposed(
    camera: Camera,
    lens: AbstractLens,
    timing: Timing,
    spans: Sequence[Span],
    backdrop: Layers,
    changing: Bool[np.ndarray, " p"],
    *,
    rays: int,
    smooth: bool = True,
    seed: int | Int[Array, ""] = 0,
) -> Float[Array, "p 3"]:
    """Radiance of all pixels while a shutter is open, row-major.

    Rays of pixels in which something changes are spread over pixel, aperture and time. Those of the others
    are as `render` has them. The sums of all are denoised together, each ray in the bin of how blurred what
    it meets is at its time: a mean over time has no finer detail than what it is of.

    Times, spans and which pixels change are known beforehand; all else may be traced.

    Args:
        camera: in whose axes the lens makes its rays.
        lens: where they come from.
        timing: when each is.
        spans: what is there then; one after the other, together all times that rays have.
        backdrop: what pixels see in which nothing changes.
        changing: pixels in which something does.
        rays: of each pixel in which something changes, and on the average of a picture without motion, whose
            rays the others have.
        smooth: as for `render`.
        seed: chooses the rays.
    """
    settings = render_settings(backdrop, lens, rays=rays, smooth=smooth)
    seed, here = seed_of(seed), jnp.asarray(changing)
    bins = _coc_bins(camera, lens, spans) if smooth else CocBins(None)
    total, light = None, jnp.zeros((len(changing), 3), dtype=camera.focal_px.dtype)
    if not changing.all():
        if settings.emitters:
            backdrop, emitters = split_at_once(backdrop, lens)
            if emitters is not None:
                light = light_at_once(emitters, backdrop, lens, seed, settings)
                light = jnp.where(here[:, None], 0.0, light)
        total = _still_sums(backdrop, lens, seed, bins, ~here, settings=settings)
    through = any(body.scene.volume.opacity is not None for span in spans for body in span.bodies)
    samples = _samples(
        lens,
        settings.rays,
        stirred(seed, _TIMED),
        with_chances=through,
        pixel_filter=settings.pixel_filter,
    )
    together = min(_TOGETHER, -(-rays // len(spans)))
    of_row = changing.reshape(camera.height, -1).sum(axis=1)
    for number, span in enumerate(spans):
        begin = None if span is spans[0] else span.begin
        end = None if span is spans[-1] else span.end
        shares = row_shares(timing, begin, end, camera.height, rays, together)
        groups = int(of_row @ shares.parts.astype(np.int64))
        if groups:
            most = _room_for(groups, together, len(changing) * -(-rays // together))
            moving = _Moving(camera, timing, _plain(span.bodies), samples, shares)
            sums = _span_sums(moving, lens, bins, here, together=together, most=most)
            total = sums if total is None else jax.tree.map(jnp.add, total, sums)
            each = stirred(seed, _TIMED + 1 + number)
            fewer = dataclasses.replace(settings, rays=-(-rays // len(spans)))
            more = _span_light(span.bodies, lens, timing, shares, each, fewer)
            light = jnp.where(here[:, None], light + more, light)
    assert total is not None
    return _developed(total, lens, camera, bins, settings=settings) + light


def _room_for(groups: int, together: int, most: int) -> int:
    """Room for at least so many groups, of which a picture has no more than `most`.

    One of few numbers, so that few programs are compiled. Rays are followed together, as many as that or as
    the device takes at once; what is not used takes no time beyond the last of these.
    """
    room, at_once = _FEWEST_GROUPS, rays_at_once() // together
    while room < min(groups, at_once):
        room *= 4
    if groups <= room <= at_once:
        return min(most, room)
    return most if most <= MOST_GROUPS else groups


def _plain(bodies: tuple[MovingLayers, ...]) -> tuple[MovingLayers, ...]:
    """Bodies without their emitters, whose rays compile nothing new where others have some."""
    return tuple(dataclasses.replace(body, emitters=None) for body in bodies)


def _span_light(
    bodies: tuple[MovingLayers, ...],
    lens: AbstractLens,
    timing: Timing,
    shares: RowShares,
    seed: UInt[Array, ""],
    settings: RenderSettings,
) -> Float[Array, "p 3"] | float:
    """The light of the emitters of all bodies in one span."""
    total: Float[Array, "p 3"] | float = 0.0
    for number, body in enumerate(bodies):
        if body.emitters is not None:
            others = _plain((*bodies[:number], *bodies[number + 1 :]))
            total += moving_light(
                body,
                others,
                lens,
                timing,
                shares,
                stirred(seed, number),
                rays=settings.rays,
                pixel_filter=settings.pixel_filter,
            )
    return total


def _coc_bins(camera: Camera, lens: AbstractLens, spans: Sequence[Span]) -> CocBins:
    """One bin where rays see highlights and mirrors for themselves."""
    bodies = [body for span in spans for body in span.bodies]
    glossy = any(body.scene.surface.gloss is not None for body in bodies)
    return CocBins(None if glossy else focal_zone(lens, camera))


@jit
def _still_sums(
    layers: Layers,
    lens: AbstractLens,
    seed: UInt[Array, ""],
    bins: CocBins,
    wanted: Bool[Array, " p"],
    *,
    settings: RenderSettings,
) -> PixelSums:
    """What `render` sums up, of the `wanted` pixels only."""
    return picture_sums(layers, lens, seed, settings, bins, known_light(lens, layers.camera), wanted)


class _Moving(eqx.Module):
    """What rays of one span go through, and which they are."""

    camera: Camera
    timing: Timing
    bodies: tuple[MovingLayers, ...]
    samples: RaySamples
    shares: RowShares


@jit
def _span_sums(
    moving: _Moving,
    lens: AbstractLens,
    bins: CocBins,
    changing: Bool[Array, " p"],
    *,
    together: int,
    most: int,
) -> PixelSums:
    """The sums over the rays of one span, of pixels that are `changing`; 0 in the others."""
    camera, samples, shares = moving.camera, moving.samples, moving.shares

    def seen(some: SomeGroups, lens: AbstractLens) -> Seen:
        _, row, number, starts = starts_of(some, samples, camera)
        assert starts.moment is not None
        moment = starts.moment.reshape(number.shape)
        time = moving.timing.times(moment, row, camera.height).reshape(-1)
        found = seen_in_motion(moving.bodies, camera, lens, starts, time, some.together)
        mine = (shares.hold(moment, row) & (number < samples.per_pixel)).reshape(-1)
        return dataclasses.replace(found, weight=jnp.where(mine, found.weight, 0.0))

    groups = timed_groups(shares, changing, camera.width, samples.per_pixel, together, most=most)
    return summed(seen, lens, groups, bins, camera.width * camera.height)


@jit
def _developed(
    sums: PixelSums, lens: AbstractLens, camera: Camera, bins: CocBins, *, settings: RenderSettings
) -> Float[Array, "p 3"]:
    return developed(sums, camera.width, bins, settings.rays, known_light(lens, camera))
