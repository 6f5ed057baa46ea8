"""How good any picture is, told by rays in some of its pixels, and how sure that is.

As for a plan's trials, R1 and R2 are plain means of independent rays, right on the average, so that
(P - R1) (P - R2) is on the average the squared error of a picture P, whoever made it. A picture that was not
made of rays may be wrong in few pixels, and there by much, which a sample of them might miss. So pixels are
told in two groups:

- those in which P is brighter than white, the only ones that can be wrong by more than what is right there
  or than white: as many as may be;
- of the others a random few, evenly.

Where they are shares s_g of the picture, n_g of their pixels are told, and m_g and v_g are the mean and
variance of what these tell, the squared error is

    E = sum s_g m_g,    known to    d = (sum s_g^2 v_g / n_g)^(1/2).

A picture is taken to be as good as E + 2 d says, which is too good in about one case of forty.
"""

import dataclasses
import time

import numpy as np
from jaxtyping import Bool, Float

from focusjax._counts import require_counts, require_seed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.trace._allot import FEWEST
from focusjax.trace._tracer import ready_tracer

_RAYS = 16
_PIXELS = 8192
"""Of each of the groups, at most."""
_SURE = 2.0
"""Standard errors."""


@dataclasses.dataclass(frozen=True)
class ToldQuality:
    """What a picture's error is, as far as rays in some of its pixels tell.

    Attributes:
        decibels: PSNR for a peak of 1; what is brighter than 1 counts relative to itself.
        at_least: PSNR that it has but for one case of forty.
        fewest_seconds: that `render` would take with the fewest rays a pixel, 4, programs being compiled; by
            what those in these pixels took, without smoothing.
    """

    decibels: float
    at_least: float
    fewest_seconds: float


def told_by_rays(
    layers: Layers,
    lens: AbstractLens,
    picture: Float[np.ndarray, "h w 3"],
    *,
    rays: int = _RAYS,
    pixel_filter: str | None = None,
    seed: int = 0,
) -> ToldQuality:
    """The quality of a picture that was made in any way, such as by post-processing.

    Args:
        layers: as for `render`.
        lens: as for `render`.
        picture: linear radiance, of the layers' size, made without the rays of this seed.
        rays: per pixel that is told, twice.
        pixel_filter: as for `render`.
        seed: chooses pixels and rays.

    Raises:
        ValueError: a picture of another size or with values that are not finite; no rays; or what `render`
            would refuse.
    """
    require_counts(rays=rays)
    require_seed(seed)
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
    told = _some(bright, seed) | _some(~bright, seed + 1)
    # The first for its programs to be compiled; so with the rays.
    ready_tracer(layers, lens, pixel_filter)
    start = time.perf_counter()
    tracer = ready_tracer(layers, lens, pixel_filter)
    ready = time.perf_counter() - start
    counts = np.where(told, rays, 0)
    one = tracer.trace(counts, rays, seed + 4, independent=True).raw()[told]
    start = time.perf_counter()
    other = tracer.trace(counts, rays, seed + 5, independent=True).raw()[told]
    whole = tracer.work(np.full(len(told), FEWEST), FEWEST)
    seconds = ready + (time.perf_counter() - start) * whole / tracer.work(counts, rays)
    # A light that the picture has too bright is not to count relative to that.
    white = np.maximum(0.5 * (one + other), 1.0)
    wrong = ((given[told] - one) * (given[told] - other) / white**2).astype(np.float64).mean(axis=1)
    error, unsure = _of_groups(wrong, bright, told)
    return ToldQuality(_psnr(error), _psnr(error + _SURE * unsure), seconds)


def _some(group: Bool[np.ndarray, " p"], seed: int) -> Bool[np.ndarray, " p"]:
    """Some pixels of a group, all being as likely."""
    members, found = np.flatnonzero(group), np.zeros(len(group), dtype=bool)
    if len(members) > _PIXELS:
        members = np.random.default_rng(seed).choice(members, _PIXELS, replace=False)
    found[members] = True
    return found


def _of_groups(
    wrong: Float[np.ndarray, " n"], bright: Bool[np.ndarray, " p"], told: Bool[np.ndarray, " p"]
) -> tuple[float, float]:
    """E and d; `wrong` is of the pixels that are told."""
    error, variance = 0.0, 0.0
    for group in (bright, ~bright):
        mine = wrong[group[told]]
        if len(mine):
            share = group.mean()
            error += share * mine.mean()
            variance += share**2 * mine.var() / len(mine)
    return float(error), float(np.sqrt(variance))


def _psnr(error: float) -> float:
    return -10.0 * float(np.log10(max(error, 1e-12)))
