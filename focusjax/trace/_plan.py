"""How many rays a wanted quality takes, and what a picture's quality is, told from a sample of its pixels.

Two pictures of the same rays per pixel but other random numbers differ by twice the error of one. On a
sixteenth of the pixels that tells the mean squared error for an eighth of the cost of a picture. From one
number of rays to another it goes about as rays^-1.3 (silhouettes as 1 / rays, smooth parts faster), so the
second or third trial is at the number that is wanted. Only the error of the rays is meant; that of the layers
stays, about 45 dB at one sample per pixel and 50 dB at two where things are in focus.
"""

import dataclasses
import time

import numpy as np
from jaxtyping import Float

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
_FALL = 1.3
_PIXELS_PER_TRIED = 16
_LEAST_PIXELS = 2048
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
    pixel_filter: str | None = None,
    seed: int = 0,
) -> RayPlan:
    """The fewest rays per pixel with which `render` can be expected to reach a quality.

    Args:
        layers: as for `render`.
        lens: as for `render`.
        quality: PSNR in dB against the picture of very many rays, as a number or text ("40 dB"); or "draft",
            "good" or "reference".
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
    tracer = ready_tracer(layers, lens, pixel_filter)
    tried: dict[int, tuple[float, float]] = {}
    count = _FIRST_TRIAL
    while count not in tried and len(tried) < _TRIALS:
        tried[count] = _trial(tracer, count, seed)
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
    tracer = ready_tracer(layers, lens, pixel_filter)
    # Neither the pixels nor the rays of a plan's trials, so that this is another word on it.
    counts = _some(tracer.counts(rays), seed + 2)
    again = tracer.means(counts, rays, seed + 2)
    traced = counts > 0
    return _decibels(np.asarray(picture).reshape(-1, 3)[traced], again[traced])


def _trial(tracer: Tracer, rays: int, seed: int) -> tuple[float, float]:
    """PSNR in dB of pictures of `rays` per pixel, and seconds that one takes."""
    whole = tracer.counts(rays)
    counts = _some(whole, seed)
    first = tracer.means(counts, rays, seed)
    start = time.perf_counter()
    second = tracer.means(counts, rays, seed + 1)
    seconds = (time.perf_counter() - start) * float(whole.sum()) / float(counts.sum())
    traced = counts > 0
    return _decibels(first[traced], second[traced]), seconds


def _decibels(first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "n 3"]) -> float:
    """PSNR of either of two pictures of one thing; what is brighter than 1 counts relative to itself."""
    difference = (first - second) / np.maximum(0.5 * (first + second), 1.0)
    error = 0.5 * float(np.mean(difference**2, dtype=np.float64))
    return -10.0 * float(np.log10(max(error, 1e-12)))


def _some(counts: np.ndarray, seed: int) -> np.ndarray:
    """Counts of a random share of the pixels, 0 for the others."""
    share = max(1.0 / _PIXELS_PER_TRIED, min(1.0, _LEAST_PIXELS / len(counts)))
    chosen = np.random.default_rng(seed).random(len(counts)) < share
    chosen[np.argmax(counts)] = True
    return np.where(chosen, counts, 0)
