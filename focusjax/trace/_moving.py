"""Rays that each have a time, through layers of things that move.

A lens ray is a straight line in the axes of the camera at its time. What moves as a rigid body (or as any
affine map, zooming cameras included) stands still in axes of its own, and there the ray is a straight line
again. So layers of a body that are peeled once, at a key time, serve for a span of times around it, without
moving a sample: it is the rays that are moved, each by its own time, and nothing is repeated as ghosts.

With P(z) = (X0 + m z, -z) the ray in the camera's axes at depth z, and M the map from there to the axes of
the
key camera, of which o = M P(0) and d is the image of (m, -1), depth there is z' = z0 + g z with z0 = -o_z and
g = -d_z, and the ray crosses the plane z' = 0 at o - d z0 / g with slopes d / g: by these it is q'(w') = a' +
b' w' (see `focusjax.geometry.LensRay`), exactly. What it meets at disparity w' there is at

    w = g w' / (1 - z0 w')

at the ray's own time. Of several bodies the one with the largest w is what the ray sees.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax.geometry import Camera, LensRay, film_offsets
from focusjax.layers import Layers, RangePyramid
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._allot import FEWEST, allot
from focusjax.trace._colour import radiance_at
from focusjax.trace._devices import Workforce
from focusjax.trace._march import first_hits
from focusjax.trace._radiances import TracedScene, traced_scene
from focusjax.trace._samples import chances, spread_points, tile_edge
from focusjax.trace._tracer import ready_tracer
from focusjax.trace._walk import path_of

_TOGETHER = 8
"""At most so many rays of a pixel, one after the other in time, that look for the same range of disparities."""
_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 22}
_ROUNDS = 4
_SLACK = 1.0
"""Samples."""
_TIME, _PUPIL, _PLACE = 1, (2, 3), (0, 4)
"""Of the five dimensions: 64 points are spread evenly in each two of them but 2 and 4, which are of little account
here: what crosses the opening as it crosses the pixel upright."""
_STIR = 0x9E3779B1
"""By which chances of one body are made independent of another's."""


class MovingLayers(eqx.Module):
    """Layers of what moves as one body, for the times of a span.

    Attributes:
        scene: the layers as rays read them, with the key camera that they are seen from.
        ranges: disparities over any square of them.
        matrices: maps [m, 3, 4] from the axes of the camera to those of the key camera in which the body
            stands still, at times evenly spaced from the first to the last of the span; straight between.
        begin: the first of these times.
        end: the last one.
        stir: changes the chances of rays, for those of bodies to be independent.
        beyond: disparity of what passes it: 0, the background, or -1, what other bodies show.
    """

    scene: TracedScene
    ranges: RangePyramid
    matrices: Float[Array, "m 3 4"]
    begin: Float[Array, ""]
    end: Float[Array, ""]
    stir: UInt[Array, ""]
    beyond: Float[Array, ""]


def moving_layers(
    layers: Layers,
    matrices: Float[np.ndarray, "m 4 4"],
    begin: float,
    end: float,
    *,
    number: int,
    backdrop: bool,
) -> MovingLayers:
    """The layers of one body with how it moves between two times; see `MovingLayers`."""
    real = layers.ranges.overall.dtype
    return MovingLayers(
        traced_scene(layers),
        layers.ranges,
        jnp.asarray(matrices[:, :3], dtype=real),
        jnp.asarray(begin, dtype=real),
        jnp.asarray(end, dtype=real),
        jnp.asarray(number * _STIR & 0xFFFFFFFF, dtype=jnp.uint32),
        jnp.asarray(0.0 if backdrop else -1.0, dtype=real),
    )


class Timing(eqx.Module):
    """When each ray is: that of the share u of a pixel's light arrives at quantile(u), a row's delay later.

    Attributes:
        quantiles: times [q] at which evenly spaced shares of the light, 0 to 1, have arrived.
        delay: by how much the bottom of the picture is later than its top.
    """

    quantiles: Float[np.ndarray, " q"]
    delay: float

    def of_row(self, row: np.ndarray, height: int) -> np.ndarray:
        """The delay of rows of the picture; none in its middle."""
        return self.delay * ((row + 0.5) / height - 0.5)

    def share_before(self, time: float, row: np.ndarray, height: int) -> np.ndarray:
        """The share of the light of some rows that has arrived at a time."""
        shares = np.linspace(0.0, 1.0, len(self.quantiles))
        return np.interp(time - self.of_row(row, height), self.quantiles, shares, left=0.0, right=1.0)


@dataclasses.dataclass(frozen=True)
class Span:
    """Times from `begin` to `end` with the bodies' layers for them, the backdrop first."""

    begin: float
    end: float
    bodies: tuple[MovingLayers, ...]


class TimedSamples(eqx.Module):
    """Ray starts for the pixels of a tile, those of a pixel in the order of their times; see `RaySamples`."""

    offset: Float[Array, "t s 2"]
    pupil: Float[Array, "t s 2"]
    moment: Float[Array, "t s"]
    chance: UInt[Array, "t s"] | None
    edge: int = eqx.field(static=True)


def timed_samples(
    lens: AbstractLens, rays: int, seed: int, *, with_chances: bool, pixel_filter: str
) -> TimedSamples:
    """Samples whose shares of time [0, 1) are one in each of as many equal parts as a pixel has rays."""
    edge = tile_edge(rays)
    points = spread_points(5, edge, rays, seed)
    order = np.argsort(points[..., _TIME], axis=1)
    points = np.take_along_axis(points, order[..., None], axis=1)
    moment = (np.arange(rays) + points[..., _TIME] * rays % 1.0) / rays
    real = jnp.zeros(()).dtype
    return TimedSamples(
        offset=jnp.asarray(film_offsets(pixel_filter, points[..., _PLACE]), dtype=real),
        pupil=eqx.filter_jit(_pupil_points)(lens, jnp.asarray(points[..., _PUPIL], dtype=real)),
        moment=jnp.asarray(np.minimum(moment, 1.0 - 2.0**-24), dtype=real),
        chance=jnp.asarray(chances(edge, rays, seed)) if with_chances else None,
        edge=edge,
    )


def _pupil_points(lens: AbstractLens, square: Float[Array, "t s 2"]) -> Float[Array, "t s 2"]:
    return jax.vmap(jax.vmap(lens.pupil_point))(square)


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
    sums = np.zeros((len(pixels), 3))
    size = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // together)
    work = [
        (span, part)
        for span in spans
        for part in _parts(span, spans, camera, timing, pixels, rays, together, size)
    ]

    def trace(number: int, shared: TimedSamples) -> tuple["_Part", np.ndarray]:
        span, part = work[number]
        chosen = tuple(jnp.asarray(a) for a in (pixels[part.place], part.first, part.last, part.shares))

        def seen(lens: AbstractLens) -> Array:
            empty = jnp.zeros((len(part.place), together), dtype=real)
            front: Front = jnp.zeros((*empty.shape, 3), dtype=real), empty, empty - 1.0
            for body in span.bodies:
                front = _in_front(
                    front, body, camera, lens, shared, quantiles, delay, *chosen[:2], together=together
                )
            return _sums(front, shared, camera, *chosen, together=together)

        return part, np.asarray(in_colour(seen, lens))[: part.count]

    for (part, values), done in Workforce(None).each(trace, len(work), samples):
        np.add.at(sums, part.place[: part.count], values)
        if progress is not None:
            progress(done)
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
    size = min(size, 1 << (len(place) - 1).bit_length())
    found = []
    for start in range(0, len(place), size):
        count = min(size, len(place) - start)
        take = np.minimum(start + np.arange(size), len(place) - 1)
        found.append(_Part(place[take], first[take], last[take], shares[take], count))
    return found


Front = tuple[Float[Array, "p s 3"], Float[Array, "p s"], Float[Array, "p s"]]
"""The radiance along rays, the share of it that arrives, and the disparity it comes from; -1 for nowhere."""


def _own(
    samples: TimedSamples, camera: Camera, pixels: Int[Array, " p"], first: Int[Array, " p"], together: int
) -> tuple[Int[Array, " p"], Callable[[Array], Array]]:
    """The number of the first ray that is taken of each pixel, and what takes them from samples."""
    tile = (pixels // camera.width % samples.edge) * samples.edge + pixels % camera.width % samples.edge
    start = jnp.minimum(first, samples.moment.shape[1] - together)

    def take(values: Array) -> Array:
        rest = values.shape[2:]

        def one(tile: Array, start: Array) -> Array:
            at = (tile, start, *(jnp.zeros_like(tile) for _ in rest))
            return jax.lax.dynamic_slice(values, at, (1, together, *rest))[0]

        return jax.vmap(one)(tile, start)

    return start, take


@eqx.filter_jit
def _in_front(
    front: Front,
    body: MovingLayers,
    camera: Camera,
    lens: AbstractLens,
    samples: TimedSamples,
    quantiles: Float[Array, " q"],
    delay: Float[Array, ""],
    pixels: Int[Array, " p"],
    first: Int[Array, " p"],
    *,
    together: int,
) -> Front:
    """What rays see of `body` where it is before what is in `front`, else that."""
    column, row = pixels % camera.width, pixels // camera.width
    _, take = _own(samples, camera, pixels, first, together)
    offset = take(samples.offset)
    film = jnp.stack([column, row], axis=-1).astype(offset.dtype)[:, None] + offset
    moment = take(samples.moment)
    late = delay * ((row.astype(offset.dtype) + 0.5) / camera.height - 0.5)
    shares = jnp.linspace(0.0, 1.0, quantiles.shape[0], dtype=quantiles.dtype)
    time = jnp.interp(moment, shares, quantiles) + late[:, None]

    def line(film: Array, pupil: Array, time: Array) -> tuple[LensRay, Array, Array]:
        ray = lens.ray(camera, film, pupil)
        moved, depth, along = moved_ray(ray, camera, body.scene.camera, _matrix_at(body, time))
        grid = body.scene.grid
        on_grid = LensRay(
            moved.a * grid.supersampling + grid.margin, moved.b * grid.supersampling, moved.weight
        )
        return on_grid, depth, along

    rays, depth, along = jax.vmap(jax.vmap(line))(film, take(samples.pupil), time)
    least, largest = jax.vmap(lambda rays: _range(body.ranges, rays))(rays)
    paths = jax.vmap(jax.vmap(path_of, in_axes=(0, None, None)))(rays, least, largest)
    # A ray that runs backwards among what has turned by more than a quarter sees none of it.
    paths = eqx.tree_at(lambda path: path.steps, paths, jnp.where(along > 0, paths.steps, 0))
    chance = None
    if samples.chance is not None:
        chance = (take(samples.chance) ^ body.stir).reshape(-1)
    paths = jax.tree.map(lambda a: a.reshape(-1), paths)
    hits = first_hits(body.scene.volume, paths, chance, depth=body.scene.volume.layers)
    hits = hits.reshape(rays.weight.shape)
    surface = body.scene.surface
    number = surface.places.number(jnp.maximum(hits, 0))
    there = jnp.where(hits >= 0, surface.disparity[number], 0.0)
    beyond = 1.0 - depth * there
    met = (hits >= 0) & (beyond > 0)
    now = jnp.where(met, along * there / jnp.where(met, beyond, 1.0), body.beyond)
    hits = jnp.where(met, hits, -1)
    radiance = jax.vmap(jax.vmap(lambda ray, hit: radiance_at(surface, ray, hit)))(rays, hits)
    nearer = now > front[2]
    return jnp.where(nearer[..., None], radiance, front[0]), rays.weight, jnp.where(nearer, now, front[2])


@eqx.filter_jit
def _sums(
    front: Front,
    samples: TimedSamples,
    camera: Camera,
    pixels: Int[Array, " p"],
    first: Int[Array, " p"],
    last: Int[Array, " p"],
    shares: Float[Array, "p 2"],
    *,
    together: int,
) -> Float[Array, "p 3"]:
    """What the rays bring that belong to a part of the work."""
    start, take = _own(samples, camera, pixels, first, together)
    moment = take(samples.moment)
    number = start[:, None] + jnp.arange(moment.shape[1], dtype=start.dtype)[None]
    mine = (number >= first[:, None]) & (number < last[:, None])
    mine &= (moment >= shares[:, :1]) & ((moment < shares[:, 1:]) | (shares[:, 1:] >= 1))
    share = jnp.where(mine, front[1], 0.0)
    return jnp.stack([(share * front[0][..., k]).sum(axis=1) for k in range(3)], axis=-1)


def moved_ray(
    ray: LensRay, camera: Camera, key: Camera, matrix: Float[Array, "3 4"]
) -> tuple[LensRay, Float[Array, ""], Float[Array, ""]]:
    """A ray in the axes in which a body stands still, z0 and g; see the head of this file.

    Args:
        ray: of `camera`.
        camera: as of the ray.
        key: the camera of the layers.
        matrix: from the axes of the one to those of the other.
    """
    slope, crossing = (ray.a - camera.principal_point) / camera.focal_px, ray.b / camera.focal_px
    turned = matrix[:, :3]
    origin = turned[:, 0] * crossing[0] - turned[:, 1] * crossing[1] + matrix[:, 3]
    direction = turned[:, 0] * slope[0] - turned[:, 1] * slope[1] - turned[:, 2]
    depth, along = -origin[2], -direction[2]
    safe = jnp.where(along > 0, along, 1.0)
    x, y = direction[0] / safe, direction[1] / safe
    a = key.principal_point + key.focal_px * jnp.stack([x, -y])
    b = key.focal_px * jnp.stack([origin[0] - x * depth, y * depth - origin[1]])
    return LensRay(a, b, ray.weight), depth, along


def _matrix_at(body: MovingLayers, time: Float[Array, ""]) -> Float[Array, "3 4"]:
    nodes = body.matrices.shape[0]
    if nodes == 1:
        return body.matrices[0]
    length = jnp.where(body.end > body.begin, body.end - body.begin, 1.0)
    place = jnp.clip((time - body.begin) / length, 0.0, 1.0) * (nodes - 1)
    before = jnp.minimum(place.astype(jnp.int32), nodes - 2)
    share = place - before.astype(place.dtype)
    return body.matrices[before] + share * (body.matrices[before + 1] - body.matrices[before])


def _range(ranges: RangePyramid, rays: LensRay) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Least and largest disparity that some rays, in grid units, can meet: as `disparity_range`."""

    def narrow(_: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
        ends = [rays.a + rays.b * w for w in state]
        low = jnp.minimum(*(end.min(axis=0) for end in ends)) - _SLACK
        high = jnp.maximum(*(end.max(axis=0) for end in ends)) + _SLACK
        least, largest, _depth = ranges.query(low, high)
        return jnp.where(largest <= 0, 0.0, least), jnp.where(largest <= 0, 0.0, largest)

    overall = ranges.overall
    start = jnp.where(overall[1] > 0, overall[0], 0.0), overall[1]
    return jax.lax.fori_loop(0, _ROUNDS, narrow, start)


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
            counts[wanted] = allot(tracer.contrast[wanted], max(whole.mean(), FEWEST))
    return tracer.means(counts, rays, seed, progress)
