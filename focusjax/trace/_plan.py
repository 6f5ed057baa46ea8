"""How many rays a wanted quality takes, from pictures of a few of the pixels.

Let A, B be plain means of independent rays in a pixel, and S that of the denoised picture of A. As A and B
are right on the average, (A - B)^2 / 2 is on the average the squared error of either; with two more means C
and D, (S - C) (S - D) is that of S, what denoising makes wrong included. The error of the picture is

    E = E_plain g,        g = (error of S) / (error of A),

E_plain from single pixels all over the picture, which differ much from one to another; g from a few windows,
as denoising takes what is around, in which it differs less. Single pixels are chosen the more often the more
the rays of theirs may differ, and count the less (Horvitz and Thompson 1952).

A first trial is of 16 rays. The second is of the number that, by the usual fall of the error with the number
of rays, should give what is wanted, 64 at most; the number planned is on the power law through both. Only the
error of the rays is meant; that of the layers stays, about 45 dB at one sample per pixel and 50 dB at two
where things are in focus.
"""

import dataclasses
import itertools
import time
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from focusjax._arguments import require_switches
from focusjax._counts import require_seed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allocate import FEWEST
from focusjax.trace._picture import light_at_once
from focusjax.trace._render import render_settings, within_reach
from focusjax.trace._some_pixels import NO_WINDOWS, Windows, prepared, some_pixels

QUALITIES = {"draft": 30.0, "good": 38.0, "reference": 46.0}
"""Names for PSNRs in dB."""
_FIRST, _LARGEST = 16, 64
"""Rays of the first trial, and of the second one at most."""
_FALL = 1.15
_FALL_UNSURE, _LEAST_FALL = 0.25, 0.7
"""The error falls as this power of the number of rays, give or take; and never slower than the last."""
_UNSURE = 0.6
"""Standard error of a trial in dB, of which its pixels are most."""
_SINGLE = 4096
"""Single pixels."""
_CORE, _AROUND = 16, 8
"""Pixels along the edge of a window's core, and around it."""
_WINDOWS, _WINDOW_PIXELS = 8, 0.04
"""Windows at least, and what share of the picture they are otherwise."""
_EVEN = 0.5
"""Share of the single pixels that are chosen alike all over the picture."""
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

    Two programs are compiled, the same for every quality and every lens of a kind.

    Args:
        layers: as for `render`.
        lens: as for `render`.
        quality: PSNR in dB against the picture of very many rays, as a number or text ("40 dB"); or "draft",
            "good" or "reference".
        smooth: as for `render`.
        pixel_filter: as for `render`.
        seed: chooses the pixels and rays of the trials.

    Raises:
        ValueError: no such quality; one that takes more than 16384 rays, naming what can be reached; or a
            lens or filter that `render` would refuse.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens)
        >>> plan = fj.plan_rays(layers, lens, "40 dB")
        >>> fj.render(layers, lens, rays=plan.rays).shape
        (6, 8, 3)
    """
    wanted = decibels_of(quality)
    seed = require_seed(seed)
    require_switches(smooth=smooth)
    trials = _Trials(layers, lens, seed, smooth=smooth, pixel_filter=pixel_filter)
    trials.run(_FIRST)
    (first,) = trials.decibels()
    second = int(np.clip(np.ceil(_FIRST * 10.0 ** ((wanted - first) / (10.0 * _FALL))), FEWEST, _LARGEST))
    trials.run(second)
    rays, decibels = _on_power_law((_FIRST, second), trials.decibels(), wanted)
    return RayPlan(rays, decibels, trials.seconds_per_ray * rays * layers.camera.width * layers.camera.height)


def _on_power_law(tried: tuple[int, int], found: Sequence[float], wanted: float) -> tuple[int, float]:
    """Rays for the wanted decibels, and the decibels expected of them, where two numbers gave those found.

    Raises:
        ValueError: more rays than can be.
    """
    # A straight line of decibels over the logarithm of the number, by what is known beforehand of its slope.
    lever = 10.0 * np.log10(np.asarray(tried) / _FIRST)
    matrix = np.stack([np.ones(2), lever], axis=1) / _UNSURE
    matrix = np.concatenate([matrix, [[0.0, 1.0 / _FALL_UNSURE]]])
    right = np.append(np.asarray(found) / _UNSURE, _FALL / _FALL_UNSURE)
    (start, fall), *_ = np.linalg.lstsq(matrix, right)
    fall = max(float(fall), _LEAST_FALL)
    rays = _FIRST * 10.0 ** ((wanted - start) / (10.0 * fall))
    if rays > _MOST:
        best = start + 10.0 * fall * np.log10(_MOST / _FIRST)
        raise ValueError(
            f"quality of {wanted:g} dB would take about {rays:.0f} rays per pixel; {best:.0f} dB can be"
            f" reached with {_MOST}, so ask for less"
        )
    count = max(FEWEST, int(np.ceil(rays)))
    return count, float(start + 10.0 * fall * np.log10(count / _FIRST))


class _Trials:
    """Independent pictures of the same few pixels, two of each number of rays that is tried."""

    def __init__(
        self, layers: Layers, lens: AbstractLens, seed: int, *, smooth: bool, pixel_filter: str | None
    ) -> None:
        settings = render_settings(layers, lens, smooth=smooth, pixel_filter=pixel_filter)
        self._settings = dataclasses.replace(settings, rays=_FIRST)
        self._filter = settings.pixel_filter
        self._lens = within_reach(layers, lens, self._filter)
        self._ready = prepared(layers, self._lens, settings=settings)
        camera, chance = layers.camera, np.random.default_rng(seed)
        self._windows, inside, self._core = NO_WINDOWS, np.zeros(0, dtype=np.int32), np.zeros(0, dtype=bool)
        if len(self._ready.bins.least) > 1:
            self._windows, inside, self._core = _windows(camera.width, camera.height, chance)
        single, self._weight = single_pixels(np.asarray(self._ready.variance), _SINGLE, chance)
        self._inside = len(inside)
        self._pixels = jnp.asarray(in_rows(np.concatenate([inside, single])))
        self._single = slice(len(inside), len(inside) + len(single))
        self._seed = 4 * seed % 2**32
        self._tried: list[int] = []
        self._plain: list[np.ndarray] = []
        self._denoised: list[np.ndarray] = []
        self._emitters = self._error_of_emitters() if self._ready.emitters is not None else 0.0
        self.seconds_per_ray = 0.0

    def run(self, rays: int) -> None:
        """Two more pictures, of so many rays; the time of the last is kept."""
        number = 2 * len(self._plain)
        start = time.perf_counter()
        plain, denoised, traced = jax.block_until_ready(
            some_pixels(
                self._lens,
                self._ready,
                self._pixels,
                jnp.int32(rays),
                jnp.uint32(self._seed + number) + jnp.arange(2, dtype=jnp.uint32),
                most_rays=_LARGEST,
                pixel_filter=self._filter,
                windows=self._windows,
            )
        )
        self.seconds_per_ray = (time.perf_counter() - start) / (2.0 * float(traced))
        self._tried.append(rays)
        self._plain.append(np.asarray(plain, dtype=np.float64))
        self._denoised.append(np.asarray(denoised, dtype=np.float64))

    def decibels(self) -> list[float]:
        """PSNR of pictures of each number of rays so far."""
        white = np.maximum(np.concatenate(self._plain).mean(axis=0), 1.0)
        found = [self._error(number, white) for number in range(len(self._plain))]
        emitters = [self._emitters * _FIRST / rays for rays in self._tried]
        return [psnr_of(sum(both)) for both in zip(found, emitters, strict=True)]

    def _error_of_emitters(self) -> float:
        """Squared error of the light of emitters, of which `_FIRST` rays a pixel draw rays of their own."""
        emitters, layers = self._ready.emitters, self._ready.layers
        assert emitters is not None
        if not int(emitters.pairs):
            return 0.0
        one, other = (
            np.asarray(light_at_once(emitters, layers, self._lens, jnp.uint32(seed), self._settings))
            for seed in (self._seed, self._seed + 1)
        )
        return float((0.5 * ((one - other) / np.maximum(0.5 * (one + other), 1.0)) ** 2).mean())

    def _error(self, number: int, white: Float[np.ndarray, "n 3"]) -> float:
        """Squared error of pictures of one number of rays; what is brighter than 1 is relative to itself."""
        one, other = self._plain[number]
        plain = (0.5 * (one - other) ** 2 / white**2).mean(axis=1)
        error = float(self._weight @ plain[self._single])
        if not self._inside:
            return error
        core, white = self._core, white[: self._inside][self._core]
        of_plain = plain[: self._inside][core].mean()
        if of_plain <= 0:
            return error
        plain = np.concatenate(self._plain)[:, : self._inside][:, core]
        squares = self._squares(number, plain, self._denoised[number][:, core])
        gain = (squares / white**2).mean() / of_plain
        return error * float(np.clip(gain, 0.01, 2.0))

    def _squares(
        self, number: int, plain: Float[np.ndarray, "k n 3"], denoised: Float[np.ndarray, "2 n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Squared errors of denoised pictures, by all pairs of plain ones of other rays."""
        if len(plain) == 2:
            return ((denoised - plain[::-1]) ** 2).mean(axis=0) - 0.5 * (plain[0] - plain[1]) ** 2
        rays = np.repeat(self._tried, 2).astype(float)
        total, weights = np.zeros_like(plain[0]), 0.0
        for own, seen in enumerate(denoised, start=2 * number):
            for one, other in itertools.combinations(set(range(len(plain))) - {own}, 2):
                # The more rays, the less noise of theirs.
                weight = rays[one] * rays[other]
                total += weight * (seen - plain[one]) * (seen - plain[other])
                weights += weight
        return total / weights


def psnr_of(error: float) -> float:
    """Decibels of a mean squared error, for a peak of 1."""
    return -10.0 * float(np.log10(max(error, 1e-12)))


def in_rows(pixels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """The list with its last one repeated, until it is as long as `some_pixels` takes it."""
    return np.pad(pixels, (0, -len(pixels) % 32), mode="edge").astype(np.int32)


def single_pixels(
    variance: Float[np.ndarray, " p"], count: int, chance: np.random.Generator
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Some pixels, those in which rays may differ the more often, and weights for the mean over all.

    Systematic sampling along the rows, with replacement where a pixel is likely enough.
    """
    pixels = len(variance)
    if pixels <= count:
        return np.arange(pixels), np.full(pixels, 1.0 / pixels)
    # About the error of a pixel that has rays in proportion to the power 0.4 of the variance.
    likely = variance.astype(np.float64) ** 0.5
    likely = _EVEN / pixels + (1.0 - _EVEN) * likely / max(likely.sum(), 1e-30)
    ends = np.cumsum(likely / likely.sum())
    places = (np.arange(count) + chance.random(count)) / count
    chosen = np.minimum(np.searchsorted(ends, places), pixels - 1)
    return chosen, 1.0 / (count * pixels * likely[chosen] / likely.sum())


def _windows(
    width: int, height: int, chance: np.random.Generator
) -> tuple[Windows, Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Windows spread over the picture, their pixels one window after another, and which are in cores.

    A window at the border ends with the picture, and its core with it.
    """
    edge = _CORE + 2 * _AROUND
    high, wide = min(edge, height), min(edge, width)
    down, across = -(-height // _CORE), -(-width // _CORE)
    count = min(max(_WINDOWS, round(_WINDOW_PIXELS * width * height / edge**2)), down * across)
    # Evenly along a row of tiles that turns at each end.
    order = np.arange(down * across).reshape(down, across)
    order[1::2] = order[1::2, ::-1]
    places = ((np.arange(count) + chance.random(count)) / count * down * across).astype(int)
    row, column = np.divmod(order.ravel()[places], across)
    top = np.clip(row * _CORE - _AROUND, 0, height - high)[:, None, None]
    left = np.clip(column * _CORE - _AROUND, 0, width - wide)[:, None, None]
    y, x = top + np.arange(high)[:, None], left + np.arange(wide)
    y, x = np.broadcast_arrays(y, x)
    core = (y // _CORE == row[:, None, None]) & (x // _CORE == column[:, None, None])
    return Windows(count, high, wide), (y * width + x).ravel(), core.ravel()
