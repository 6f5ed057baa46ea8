"""How many rays a wanted quality takes, and what a picture's quality is, told from parts of it.

Let S be the smoothed picture of some rays and R1, R2 plain means of others, all independent. As R1 and R2 are
right on the average, the mean of

    (S - R1) (S - R2)

is the squared error of S, what smoothing makes wrong included. A trial traces small squares of the picture, a
twelfth of it, as smoothing takes what is around. Where rays are aimed at lights, which are few pixels and may
be wrong by much, there are squares for these alone: around random ones of them, in which each counts the less
the more of them it may have been chosen with. From one number of rays to another the error goes about as
rays^-1, so the second or third trial is at the number that is wanted. Only the error of the rays is meant;
that of the layers stays, about 45 dB at one sample per pixel and 50 dB at two where things are in focus.
"""

import dataclasses
import time

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import uniform_filter

from focusjax._arguments import require_switches
from focusjax._counts import require_counts, require_seed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allot import FEWEST
from focusjax.trace._tracer import Tracer, ready_tracer

QUALITIES = {"draft": 30.0, "good": 38.0, "reference": 46.0}
"""Names for PSNRs in dB."""
_FIRST_TRIAL = 16
_TRIALS = 6
_NEAR = 0.75
"""Decibels above what is wanted, within which no smaller number of rays is tried."""
_FALL = 1.0
_PIXELS_PER_TRIED = 12
_LEAST_PIXELS = 16384
_AIMED_SQUARES = 32
_SQUARE, _AROUND = 24, 6
"""Pixels along the edge of a square, and around it that are traced for it."""
_MOST = 1 << 14


@dataclasses.dataclass(frozen=True)
class RayPlan:
    """Rays for a picture, and what to expect of them.

    Attributes:
        rays: per pixel on the average.
        decibels: expected PSNR of the rays alone, for a peak of 1.
        seconds: expected for the picture at most, programs being compiled: the few pixels of a trial take
            more time each.
    """

    rays: int
    decibels: float
    seconds: float


def decibels_of(quality: str | float) -> float:
    """A quality such as "40 dB", 40 or "good", in dB.

    Raises:
        ValueError: no such quality.

    Example:
        >>> decibels_of("40 dB"), decibels_of("draft")
        (40.0, 30.0)
    """
    if isinstance(quality, str) and quality in QUALITIES:
        return QUALITIES[quality]
    text = quality.removesuffix("dB") if isinstance(quality, str) else quality
    try:
        decibels = float(text)
    except ValueError:
        decibels = np.nan
    if not 10.0 <= decibels <= 80.0:
        names = ", ".join(QUALITIES)
        raise ValueError(f"quality is {quality!r}; expected 10 to 80 dB, such as '40 dB', or one of {names}")
    return decibels


def plan_rays(
    layers: Layers,
    lens: AbstractLens,
    quality: str | float,
    *,
    smooth: bool = True,
    pixel_filter: str | None = None,
    seed: int = 0,
) -> RayPlan:
    """The fewest rays per pixel with which `render` can be expected to reach a quality.

    Args:
        layers: as for `render`.
        lens: as for `render`.
        quality: PSNR in dB against the picture of very many rays, as a number or text ("40 dB"); or "draft",
            "good" or "reference".
        smooth: as for `render`.
        pixel_filter: as for `render`.
        seed: chooses the rays of the trial.

    Raises:
        ValueError: no such quality; one that takes more than 16384 rays, naming what can be reached; or a
            lens or filter that `render` would refuse.

    Example:
        >>> plan = plan_rays(layers, lens, "40 dB")  # doctest: +SKIP
        >>> image = render(layers, lens, rays=plan.rays)  # doctest: +SKIP
    """
    wanted = decibels_of(quality)
    require_seed(seed)
    require_switches(smooth=smooth)
    tracer = ready_tracer(layers, lens, pixel_filter)
    tried: dict[int, tuple[float, float]] = {}
    count = _FIRST_TRIAL
    while count not in tried and len(tried) < _TRIALS:
        tried[count] = _trial(tracer, count, seed, smooth=smooth)
        if wanted <= tried[count][0] < wanted + _NEAR:
            break
        count = _next_trial({rays: decibels for rays, (decibels, _) in tried.items()}, wanted)
    enough = [rays for rays, (decibels, _) in tried.items() if decibels >= wanted]
    nearest = min(enough) if enough else max(tried)
    count = nearest if enough else count
    decibels, seconds = tried[nearest]
    expected = decibels + 10.0 * _FALL * np.log10(count / nearest)
    return RayPlan(count, float(expected), seconds * count / nearest)


def _next_trial(tried: dict[int, float], wanted: float) -> int:
    """The number of rays that should give the wanted decibels, after those that some gave.

    Between two of them where there is one on either side.

    Raises:
        ValueError: more rays than can be.
    """
    fewer = max((rays for rays, decibels in tried.items() if decibels < wanted), default=None)
    more = min((rays for rays, decibels in tried.items() if decibels >= wanted), default=None)
    if fewer is not None and more is not None:
        share = (wanted - tried[fewer]) / (tried[more] - tried[fewer])
        return int(np.clip(np.ceil(fewer * (more / fewer) ** share), min(fewer + 1, more), more))
    known = fewer if fewer is not None else more
    assert known is not None
    rays = known * 10.0 ** ((wanted - tried[known]) / (10.0 * _FALL))
    if rays > _MOST:
        best = tried[known] + 10.0 * _FALL * np.log10(_MOST / known)
        raise ValueError(
            f"quality of {wanted:g} dB would take about {rays:.0f} rays per pixel; {best:.0f} dB can be"
            f" reached with {_MOST}, so ask for less"
        )
    return max(FEWEST, int(np.ceil(rays)))


def quality_of(
    layers: Layers,
    lens: AbstractLens,
    picture: Float[np.ndarray, "h w 3"],
    *,
    rays: int,
    pixel_filter: str | None = None,
    seed: int = 0,
) -> float:
    """PSNR in dB of the rays of a `picture` that `render` made with `rays`, `pixel_filter` and `seed`.

    The peak is 1; what is brighter counts relative to itself. A sample of the pixels is traced again with
    other rays, as many.
    """
    require_counts(rays=rays)
    require_seed(seed)
    tracer = ready_tracer(layers, lens, pixel_filter)
    # Neither the pixels nor the rays of a plan's trials, so that this is another word on it.
    whole = tracer.counts(rays)
    share = max(1.0 / _PIXELS_PER_TRIED, min(1.0, _LEAST_PIXELS / len(whole)))
    told = np.random.default_rng(seed + 2).random(len(whole)) < share
    told[np.argmax(whole)] = True
    one, other = (
        tracer.trace(np.where(told, whole, 0), rays, seed + k, independent=True).raw()[told] for k in (2, 3)
    )
    given = np.asarray(picture).reshape(-1, 3)[told]
    return _decibels(given, one, other, np.full(len(given), 1.0 / len(given)))


def _trial(tracer: Tracer, rays: int, seed: int, *, smooth: bool) -> tuple[float, float]:
    """PSNR in dB of pictures of `rays` per pixel, and seconds that one takes."""
    whole, camera = tracer.counts(rays), tracer.layers.camera
    traced, weight = _told(tracer, camera.height, camera.width, seed)
    told = weight > 0
    counts = np.where(traced, whole, 0)
    classes = tracer.classes if smooth else None
    # Few rays would tell little of what they miss themselves.
    sure = max(rays, _FIRST_TRIAL)
    told_counts = np.where(told, tracer.counts(sure), 0)
    checks = [tracer.trace(told_counts, sure, seed + k, classes=classes, independent=True) for k in (1, 2)]
    one, other = (check.raw()[told] for check in checks)
    # For its programs to be compiled.
    tracer.trace(counts, rays, seed, classes=classes).smooth()
    start = time.perf_counter()
    found = tracer.trace(counts, rays, seed, classes=classes)
    seconds = (time.perf_counter() - start) * float(whole.sum()) / float(counts.sum())
    start = time.perf_counter()
    picture = found.smooth()[told]
    seconds += time.perf_counter() - start
    return _decibels(picture, one, other, weight[told]), seconds


def _decibels(
    picture: Float[np.ndarray, "n 3"],
    one: Float[np.ndarray, "n 3"],
    other: Float[np.ndarray, "n 3"],
    weight: Float[np.ndarray, " n"],
) -> float:
    """PSNR of some pixels by two means of other rays; what is brighter than 1 counts relative to itself.

    What is less than can be told from so many is as much as can. `weight` sums to 1.
    """
    white = np.maximum(0.5 * (one + other), 1.0)
    relative = ((picture - one) * (picture - other) / white**2).astype(np.float64).mean(axis=1)
    error = weight @ relative
    sure = np.sqrt(weight**2 @ (relative - error) ** 2)
    return -10.0 * float(np.log10(max(error, sure, 1e-12)))


def _told(
    tracer: Tracer, height: int, width: int, seed: int
) -> tuple[Bool[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Pixels that a trial traces, and what those that it tells of count, in all 1."""
    pixels = height * width
    if pixels <= _LEAST_PIXELS:
        return np.ones(pixels, dtype=bool), np.full(pixels, 1.0 / pixels)
    traced, told = _squares(height, width, seed)
    aims = tracer.aims_from
    if not aims.any():
        return traced, told / told.sum()
    plain, share = told & ~aims, aims.mean()
    weight = np.where(plain, (1.0 - share) / max(plain.sum(), 1), 0.0)
    chance = np.random.default_rng(seed + 1)
    centres = np.unravel_index(chance.choice(np.flatnonzero(aims), _AIMED_SQUARES), (height, width))
    more_traced, chosen = (np.zeros((height, width), dtype=bool) for _ in range(2))
    for y, x in zip(*centres, strict=True):
        for mark, reach in ((more_traced, _SQUARE // 2 + _AROUND), (chosen, _SQUARE // 2)):
            mark[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1] = True
    # A pixel is chosen with any centre so near.
    near = uniform_filter(aims.reshape(height, width).astype(float), _SQUARE + 1, mode="constant").ravel()
    chosen = chosen.ravel() & aims
    counts = np.where(chosen, 1.0 / np.maximum(near, 0.5 / (_SQUARE + 1) ** 2), 0.0)
    return traced | more_traced.ravel(), weight + share * counts / counts.sum()


def _squares(height: int, width: int, seed: int) -> tuple[Bool[np.ndarray, " p"], Bool[np.ndarray, " p"]]:
    """Pixels to be traced and, of these, to be told of: squares, of each part of the picture one."""
    pixels = height * width
    edge = _SQUARE + 2 * _AROUND
    squares = max(pixels / _PIXELS_PER_TRIED, _LEAST_PIXELS) / edge**2
    down = max(1, round(np.sqrt(squares * height / width)))
    across = max(1, round(squares / down))
    traced, told = (np.zeros((height, width), dtype=bool) for _ in range(2))
    chance = np.random.default_rng(seed)
    for row in range(down):
        for column in range(across):
            y, x = (
                int((place + chance.random()) / parts * max(size - edge, 1))
                for place, parts, size in ((row, down, height), (column, across, width))
            )
            traced[y : y + edge, x : x + edge] = True
            told[y + _AROUND : y + edge - _AROUND, x + _AROUND : x + edge - _AROUND] = True
    return traced.ravel(), told.ravel()
