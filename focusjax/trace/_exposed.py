"""Pictures of bodies that move: the rays of some pixels, span after span of the shutter's time."""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt
from scipy.sparse import csr_array

from focusjax.geometry import Camera
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._allot import FEWEST
from focusjax.trace._blur_classes import ONE_CLASS, BlurClasses, blur_classes
from focusjax.trace._class_sums import added_up, by_class, class_sums, told_apart
from focusjax.trace._devices import Workforce
from focusjax.trace._focal_zone import focal_zone
from focusjax.trace._known_light import known_light
from focusjax.trace._moving import Front, MovingLayers, in_front
from focusjax.trace._timed import TimedSamples, Timing, timed_samples
from focusjax.trace._traced import Traced
from focusjax.trace._tracer import Tracer, ready_tracer

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
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Float[np.ndarray, "p 3"]:
    """Radiance of all pixels while a shutter is open, row-major.

    Rays of pixels in which something changes are spread over pixel, opening and time. Those of the others are
    as `render` has them. All are told apart by how blurred what they meet is at their time, and smoothed
    together; a mean over time has no finer detail than what it is of.

    Args:
        camera: in whose axes the lens makes its rays.
        lens: where they come from.
        timing: when each is.
        spans: what is there then; one after the other, together all times that rays have.
        backdrop: what pixels see in which nothing changes.
        changing: pixels in which something does.
        rays: of each pixel in which something changes, and on the average of the others.
        smooth: as for `render`, unless highlights are aimed at beside pixels in which something changes.
        seed: chooses the rays.
        progress: told the share done.
    """
    tracer = None if changing.all() else ready_tracer(backdrop, lens, None)
    # Small highlights are aimed at from pixels in which nothing changes, whose sums are without them then.
    alike = tracer is None or not tracer.aims or not changing.any()
    classes = _classes(lens, camera, spans) if smooth and alike else ONE_CLASS
    told = None if changing.any() else progress
    still = (
        None if tracer is None else _still(tracer, ~changing, classes, rays=rays, seed=seed, progress=told)
    )
    pixel_filter = backdrop.pixel_filter
    samples = timed_samples(lens, rays, seed, with_chances=_seen_through(spans), pixel_filter=pixel_filter)
    sums = _moving_sums(camera, lens, timing, spans, classes, changing, samples, progress)
    apart, over = by_class(sums)
    traced = Traced(
        sums=apart,
        over=over,
        aimed=0.0,
        least=classes.least,
        width=camera.width,
        rays=rays,
        known=known_light(lens, camera),
    )
    if still is not None:
        traced = dataclasses.replace(
            traced, sums=apart + still.sums, over=over + still.over, aimed=still.aimed
        )
    return traced.smooth()


def _classes(lens: AbstractLens, camera: Camera, spans: Sequence[Span]) -> BlurClasses:
    """Those of all that any span shows; one where rays see highlights and mirrors for themselves."""
    bodies = [body for span in spans for body in span.bodies]
    if any(body.scene.surface.gloss is not None for body in bodies):
        return ONE_CLASS
    far = jnp.zeros(camera.width * camera.height)
    # What comes nearer within a span is of the nearest class all the same.
    nearest = max(float(body.ranges.overall[1]) for body in bodies)
    return blur_classes(focal_zone(lens, camera), jnp.full_like(far, nearest), far)


def _still(
    tracer: Tracer,
    wanted: Bool[np.ndarray, " p"],
    classes: BlurClasses,
    *,
    rays: int,
    seed: int,
    progress: Callable[[float], None] | None,
) -> Traced:
    """What `render` traces, in the `wanted` pixels only, `rays` on their average; 0 in the others."""
    counts = np.zeros(len(wanted), dtype=np.int64)
    whole = np.full(len(wanted), rays) if rays < FEWEST else tracer.counts(rays)
    counts[wanted] = whole[wanted]
    if rays >= FEWEST and not wanted.all():
        counts[wanted] = tracer.allotted(max(whole.mean(), FEWEST), wanted)
    return tracer.trace(counts, rays, seed, progress, classes=classes)


def _seen_through(spans: Sequence[Span]) -> bool:
    """Whether rays need chances to stop at what is there in part only."""
    return any(body.scene.volume.opacity is not None for span in spans for body in span.bodies)


def _moving_sums(
    camera: Camera,
    lens: AbstractLens,
    timing: Timing,
    spans: Sequence[Span],
    classes: BlurClasses,
    changing: Bool[np.ndarray, " p"],
    samples: TimedSamples,
    progress: Callable[[float], None] | None,
) -> csr_array:
    """Means over the rays of each pixel that is `changing`, as `class_sums` tells them; 0 for the others."""
    rays, real = samples.moment.shape[1], samples.moment.dtype
    pixels = np.flatnonzero(changing).astype(np.int32)
    together = min(_TOGETHER, max(1, -(-rays // len(spans))))
    quantiles = jnp.asarray(timing.quantiles, dtype=real)
    delay = jnp.asarray(timing.delay, dtype=real)
    size = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // together)
    work = [
        (span, part)
        for span in spans
        for part in _parts(span, spans, camera, timing, pixels, rays, together, size)
    ]
    in_each = bool(lens.channels())

    def trace(number: int, shared: TimedSamples) -> tuple[Int[np.ndarray, " d"], csr_array]:
        span, part = work[number]
        chosen = tuple(jnp.asarray(a) for a in (part.pixels, part.first, part.last, part.shares))
        starts = _starts(shared, camera, quantiles, delay, *chosen, together=together)
        place = jnp.asarray(part.place)

        def seen(lens: AbstractLens) -> Float[Array, "p k c"]:
            empty = jnp.zeros((len(part.place), together), dtype=real)
            front: Front = jnp.zeros((*empty.shape, 3), dtype=real), empty, empty - 1.0
            for body in span.bodies:
                front = in_front(
                    front, body, camera, lens, starts.film, starts.pupil, starts.time, starts.chance
                )
            return _sums(front, starts.mine, chosen[0], place, classes, in_each=in_each)

        found = np.asarray(in_colour(seen, lens))[: len(part.places)]
        return part.places, csr_array(found.reshape(len(found), -1) / rays)

    found = []
    for part, done in Workforce(None).each(trace, len(work), samples):
        found.append(part)
        if progress is not None:
            progress(done)
    return added_up(found, (len(changing), told_apart(lens, classes)), real)


@dataclasses.dataclass(frozen=True)
class _Part:
    """Some rays of some pixels: of each, those from `first` until `last` whose times are between `shares`.

    Their numbers are `pixels`, and `places` each once. What a row of rays brings is added up at its `place`
    among these; there is none for what only fills the part.
    """

    pixels: Int[np.ndarray, " b"]
    first: Int[np.ndarray, " b"]
    last: Int[np.ndarray, " b"]
    shares: Float[np.ndarray, "b 2"]
    places: Int[np.ndarray, " d"]
    place: Int[np.ndarray, " b"]


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
    """The rays of a span in parts of one size; what fills the last one counts for nothing."""
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
        take = np.minimum(start + np.arange(size), len(place) - 1)
        # Rays of a pixel follow one another.
        places, among = np.unique(place[take], return_inverse=True)
        among[len(place) - start :] = size
        numbers = pixels[place[take]], first[take], last[take]
        found.append(_Part(*numbers, shares[take], pixels[places], among.astype(np.int32)))
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
def _sums(
    front: Front,
    mine: Bool[Array, "p s"],
    pixels: Int[Array, " p"],
    place: Int[Array, " p"],
    classes: BlurClasses,
    *,
    in_each: bool,
) -> Float[Array, "p k c"]:
    """`class_sums` of the rays that are to be counted."""
    along, share, disparity = front
    return class_sums(along, jnp.where(mine, share, 0.0), disparity, pixels, place, classes, in_each=in_each)
