"""Pictures of bodies that move: the rays of some pixels, span after span of the shutter's time."""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax.geometry import Camera
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._allot import FEWEST
from focusjax.trace._devices import Workforce
from focusjax.trace._known_light import evened, known_light
from focusjax.trace._moving import Front, MovingLayers, in_front
from focusjax.trace._timed import TimedSamples, Timing, timed_samples
from focusjax.trace._tracer import ready_tracer

_TOGETHER = 8
"""At most so many rays of a pixel, one after the other in time, that look up one range of disparities."""
_FEWEST_PARTS = 1 << 12
"""Traced together: fewer would need other programs, and save next to nothing."""
_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 22}


@dataclasses.dataclass(frozen=True)
class Span:
    """Times from `begin` to `end` with the bodies' layers for them, the backdrop first."""

    begin: float
    end: float
    bodies: tuple[MovingLayers, ...]


def moving_means(
    camera: Camera,
    lens: AbstractLens,
    timing: Timing,
    spans: Sequence[Span],
    pixels: Int[np.ndarray, " p"],
    *,
    rays: int,
    pixel_filter: str = "box",
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Float[np.ndarray, "p 3"]:
    """Mean radiance of some pixels over `rays` rays each, spread over pixel, opening and time.

    Args:
        camera: in whose axes the lens makes its rays.
        lens: where they come from.
        timing: when each is.
        spans: what is there then; one after the other, together all times that rays have.
        pixels: row-major numbers.
        rays: of each pixel.
        pixel_filter: spreads rays over the pixel.
        seed: chooses them.
        progress: told the share done.
    """
    seen_through = any(body.scene.volume.opacity is not None for span in spans for body in span.bodies)
    samples = timed_samples(lens, rays, seed, with_chances=seen_through, pixel_filter=pixel_filter)
    together = min(_TOGETHER, max(1, -(-rays // len(spans))))
    real = samples.moment.dtype
    quantiles = jnp.asarray(timing.quantiles, dtype=real)
    delay = jnp.asarray(timing.delay, dtype=real)
    known = known_light(lens, camera)
    sums = np.zeros((len(pixels), 3 if known is None else 6))
    size = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // together)
    work = [
        (span, part)
        for span in spans
        for part in _parts(span, spans, camera, timing, pixels, rays, together, size)
    ]

    def trace(number: int, shared: TimedSamples) -> tuple["_Part", np.ndarray]:
        span, part = work[number]
        chosen = tuple(jnp.asarray(a) for a in (pixels[part.place], part.first, part.last, part.shares))
        starts = _starts(shared, camera, quantiles, delay, *chosen, together=together)

        def seen(lens: AbstractLens) -> Array:
            empty = jnp.zeros((len(part.place), together), dtype=real)
            front: Front = jnp.zeros((*empty.shape, 3), dtype=real), empty, empty - 1.0
            for body in span.bodies:
                front = in_front(
                    front, body, camera, lens, starts.film, starts.pupil, starts.time, starts.chance
                )
            return _sums(front, starts.mine, with_light=known is not None)

        found = np.asarray(in_colour(seen, lens))[: part.count]
        return part, found.reshape(len(found), -1)

    for (part, values), done in Workforce(None).each(trace, len(work), samples):
        np.add.at(sums, part.place[: part.count], values)
        if progress is not None:
            progress(done)
    if known is not None:
        here = jax.tree.map(lambda values: values[pixels], known)
        return np.asarray(evened(sums[:, :3] / rays, sums[:, 3:] / rays, here))
    return sums / rays


@dataclasses.dataclass(frozen=True)
class _Part:
    """Some rays of some pixels: of each, those from `first` until `last` whose times are between `shares`."""

    place: Int[np.ndarray, " b"]
    first: Int[np.ndarray, " b"]
    last: Int[np.ndarray, " b"]
    shares: Float[np.ndarray, "b 2"]
    count: int


def _parts(
    span: Span,
    spans: Sequence[Span],
    camera: Camera,
    timing: Timing,
    pixels: Int[np.ndarray, " p"],
    rays: int,
    together: int,
    size: int,
) -> list[_Part]:
    """The rays of a span in parts of one size, the last rays repeated to fill it."""
    height = camera.height
    rows = np.arange(height)
    low = np.zeros(height) if span is spans[0] else timing.share_before(span.begin, rows, height)
    high = np.ones(height) if span is spans[-1] else timing.share_before(span.end, rows, height)
    # What rounding adds to a whole number of rays is none.
    begin = np.floor(low * rays + 1e-6).astype(np.int32)
    end = np.where(high > low, np.ceil(high * rays - 1e-6), begin).astype(np.int32)
    row = pixels // camera.width
    chunks = -(-(end - begin) // together)
    place = np.repeat(np.arange(len(pixels), dtype=np.int32), chunks[row])
    if not len(place):
        return []
    number = np.arange(len(place)) - np.repeat(np.cumsum(chunks[row]) - chunks[row], chunks[row])
    of = row[place]
    first = (begin[of] + together * number).astype(np.int32)
    last = np.minimum(first + together, end[of]).astype(np.int32)
    shares = np.stack([low, high], axis=1)[of].astype(np.float32)
    size = min(size, max(_FEWEST_PARTS, 1 << (len(place) - 1).bit_length()))
    found = []
    for start in range(0, len(place), size):
        count = min(size, len(place) - start)
        take = np.minimum(start + np.arange(size), len(place) - 1)
        found.append(_Part(place[take], first[take], last[take], shares[take], count))
    return found


class _Starts(eqx.Module):
    """Rays of pixels: film and pupil points, times, chances, and which of them are to be counted."""

    film: Float[Array, "p s 2"]
    pupil: Float[Array, "p s 2"]
    time: Float[Array, "p s"]
    chance: UInt[Array, "p s"] | None
    mine: Bool[Array, "p s"]


@eqx.filter_jit
def _starts(
    samples: TimedSamples,
    camera: Camera,
    quantiles: Float[Array, " q"],
    delay: Float[Array, ""],
    pixels: Int[Array, " p"],
    first: Int[Array, " p"],
    last: Int[Array, " p"],
    shares: Float[Array, "p 2"],
    *,
    together: int,
) -> _Starts:
    """The rays of a part of the work, and some more that fill it."""
    column, row = pixels % camera.width, pixels // camera.width
    tile = (row % samples.edge) * samples.edge + column % samples.edge
    start = jnp.minimum(first, samples.moment.shape[1] - together)

    def take(values: Array) -> Array:
        rest = values.shape[2:]

        def one(tile: Array, start: Array) -> Array:
            at = (tile, start, *(jnp.zeros_like(tile) for _ in rest))
            return jax.lax.dynamic_slice(values, at, (1, together, *rest))[0]

        return jax.vmap(one)(tile, start)

    moment, offset = take(samples.moment), take(samples.offset)
    late = delay * ((row.astype(moment.dtype) + 0.5) / camera.height - 0.5)
    even = jnp.linspace(0.0, 1.0, quantiles.shape[0], dtype=quantiles.dtype)
    number = start[:, None] + jnp.arange(together, dtype=start.dtype)[None]
    mine = (number >= first[:, None]) & (number < last[:, None])
    mine &= (moment >= shares[:, :1]) & ((moment < shares[:, 1:]) | (shares[:, 1:] >= 1))
    return _Starts(
        film=jnp.stack([column, row], axis=-1).astype(offset.dtype)[:, None] + offset,
        pupil=take(samples.pupil),
        time=jnp.interp(moment, even, quantiles) + late[:, None],
        chance=None if samples.chance is None else take(samples.chance),
        mine=mine,
    )


@eqx.filter_jit
def _sums(front: Front, mine: Bool[Array, "p s"], *, with_light: bool) -> Float[Array, "p *two 3"]:
    """What the rays bring that are to be counted; and, `with_light`, the share of it that arrives."""
    share = jnp.where(mine, front[1], 0.0)
    brought = jnp.stack([(share * front[0][..., k]).sum(axis=1) for k in range(3)], axis=-1)
    if not with_light:
        return brought
    light = jnp.broadcast_to(share.sum(axis=1)[:, None], brought.shape)
    return jnp.stack([brought, light], axis=1)


def some_means(
    layers: Layers,
    lens: AbstractLens,
    wanted: Bool[np.ndarray, " p"],
    *,
    rays: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Float[np.ndarray, "p 3"]:
    """The picture of `render` in the `wanted` pixels only, `rays` on their average; 0 in the others."""
    tracer = ready_tracer(layers, lens, None)
    counts = np.zeros(len(wanted), dtype=np.int64)
    if wanted.any():
        whole = np.full(len(wanted), rays) if rays < FEWEST else tracer.counts(rays)
        counts[wanted] = whole[wanted]
        if rays >= FEWEST and not wanted.all():
            counts[wanted] = tracer.allotted(max(whole.mean(), FEWEST), wanted)
    return tracer.trace(counts, rays, seed, progress, apart=False).raw()
