"""The error of any picture, estimated by rays in some of its pixels, with a confidence interval.

As for a plan's trials, A and B are plain means of independent rays, right on the average, so that
(P - A) (P - B) is on the average the squared error of a picture P, whoever made it. A picture that was not
made of rays may be wrong in few pixels, and there by much, which a sample of them might miss. So pixels are
sampled in two strata:

- those in which P is brighter than white, the only ones that can be wrong by more than what is right there
  or than white: as many as may be;
- of the others a random few, evenly.

Where they are shares s_g of the picture, n_g of their pixels are sampled, and m_g and v_g are the mean and
variance of the squared errors of these, the squared error is

    E = sum s_g m_g,    with standard error    d = (sum s_g^2 v_g / n_g)^(1/2).

A picture is taken to be as good as E + 2 d says, which is too good in about one case of forty.
"""

import dataclasses
import time

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._counts import require_counts, require_seed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allocate import FEWEST
from focusjax.trace._picture import light_at_once
from focusjax.trace._plan import in_rows, psnr_of
from focusjax.trace._render import render_settings, within_reach
from focusjax.trace._some_pixels import prepared, some_pixels

_RAYS = 16
_LARGEST = 64
"""Rays for which the program is made, unless more are asked for."""
_PIXELS = 8192
"""Of each stratum, at most."""
_STANDARD_ERRORS = 2.0
_OTHER_STREAM = 0x5EED
"""Added to the seed: other rays than those of a plan, or of the picture by the same seed."""


@dataclasses.dataclass(frozen=True)
class QualityEstimate:
    """The estimated error of a picture.

    Attributes:
        decibels: PSNR for a peak of 1; what is brighter than 1 counts relative to itself.
        at_least: PSNR that it has but for one case of forty.
        fewest_seconds: that `render` would take with the fewest rays a pixel, 4, programs being compiled; by
            what those in these pixels took, without denoising.
    """

    decibels: float
    at_least: float
    fewest_seconds: float


def estimate_quality(
    layers: Layers,
    lens: AbstractLens,
    picture: Float[np.ndarray, "h w 3"] | Float[Array, "h w 3"],
    *,
    rays: int = _RAYS,
    pixel_filter: str | None = None,
    seed: int = 0,
) -> QualityEstimate:
    """The quality of a picture that was made in any way: by `render`, or such as by post-processing.

    Args:
        layers: as for `render`.
        lens: as for `render`.
        picture: linear radiance, of the layers' size.
        rays: per pixel on the average, twice; of no use beyond those that the picture was made of, and at
            least 4.
        pixel_filter: as for `render`.
        seed: chooses pixels and rays; that of the picture may be given.

    Raises:
        ValueError: a picture of another size or with values that are not finite; no rays; or what `render`
            would refuse.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens)
        >>> picture = fj.render(layers, lens, rays=32)
        >>> fj.estimate_quality(layers, lens, picture, rays=32).decibels > 40
        True
    """
    require_counts(rays=rays)
    seed = require_seed(seed)
    camera, given = layers.camera, np.asarray(picture)
    if given.shape != (camera.height, camera.width, 3):
        raise ValueError(
            f"the picture has shape {given.shape}; expected that of the layers,"
            f" ({camera.height}, {camera.width}, 3)"
        )
    if not np.isfinite(given).all():
        raise ValueError("the picture has values that are not finite; expected linear radiance")
    given = given.reshape(-1, 3)
    bright = given.max(axis=1) > 1.0
    chance = np.random.default_rng(seed)
    sampled = _sampled(bright, chance), _sampled(~bright, chance)
    pixels = np.concatenate(sampled)
    means, seconds = _two_means(layers, lens, pixels, max(rays, FEWEST), pixel_filter, seed)
    # A light that the picture has too bright is not to count relative to that.
    white = np.maximum(means.mean(axis=0), 1.0)
    wrong = ((given[pixels] - means[0]) * (given[pixels] - means[1]) / white**2).mean(axis=1)
    error, variance = 0.0, 0.0
    for stratum, mine in zip((bright, ~bright), np.split(wrong, [len(sampled[0])]), strict=True):
        if len(mine):
            error += stratum.mean() * mine.mean()
            variance += stratum.mean() ** 2 * mine.var() / len(mine)
    unsure = float(np.sqrt(variance))
    # An error that the sample cannot resolve (it may be below 0) counts as a tenth of the standard error.
    at_most = error + _STANDARD_ERRORS * unsure
    return QualityEstimate(psnr_of(max(error, 0.1 * unsure)), psnr_of(at_most), seconds)


def _two_means(
    layers: Layers,
    lens: AbstractLens,
    pixels: Int[np.ndarray, " n"],
    rays: int,
    pixel_filter: str | None,
    seed: int,
) -> tuple[Float[np.ndarray, "2 n 3"], float]:
    """Independent means in some pixels, and seconds of a picture with the fewest rays."""
    settings = render_settings(layers, lens, rays=rays, smooth=False, pixel_filter=pixel_filter)
    chosen = settings.pixel_filter
    lens = within_reach(layers, lens, chosen)
    # The first for its program to be compiled; so with the rays.
    plain = dataclasses.replace(settings, rays=FEWEST, derivative_rays=FEWEST)
    jax.block_until_ready(prepared(layers, lens, settings=plain))
    start = time.perf_counter()
    ready = jax.block_until_ready(prepared(layers, lens, settings=plain))
    preparing = time.perf_counter() - start
    listed = jnp.asarray(in_rows(pixels))
    largest = max(_LARGEST, 1 << (rays - 1).bit_length())
    found = []
    tracing, traced = 0.0, 1.0
    for number in range(2):
        stream = (2 * seed + number + _OTHER_STREAM) & 0xFFFFFFFF
        start = time.perf_counter()
        mean, _, traced = jax.block_until_ready(
            some_pixels(
                lens,
                ready,
                listed,
                jnp.int32(rays),
                jnp.full(1, stream, dtype=jnp.uint32),
                most_rays=largest,
                pixel_filter=chosen,
            )
        )
        tracing = time.perf_counter() - start
        means = np.asarray(mean[0, : len(pixels)], dtype=np.float64)
        if ready.emitters is not None and int(ready.emitters.pairs):
            light = light_at_once(ready.emitters, ready.layers, lens, jnp.uint32(stream), settings)
            means = means + np.asarray(light, dtype=np.float64)[pixels]
        found.append(means)
    camera = layers.camera
    whole = FEWEST * camera.width * camera.height
    return np.stack(found), preparing + tracing * whole / max(float(traced), 1.0)


def _sampled(stratum: Bool[np.ndarray, " p"], chance: np.random.Generator) -> Int[np.ndarray, " n"]:
    """Some pixels of a stratum, all being as likely."""
    members = np.flatnonzero(stratum)
    return members if len(members) <= _PIXELS else chance.choice(members, _PIXELS, replace=False)
