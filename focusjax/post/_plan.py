"""Whether a picture by post-processing is good enough, and quick enough."""

import dataclasses
import time

import jax
import numpy as np

from focusjax._counts import require_counts, require_seed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.post._process import post_process
from focusjax.post._view import PinholeView
from focusjax.trace import decibels_of, estimate_quality

PLACES = 16
"""To look at per pixel: with twice as many it takes twice as long and is hardly better."""


@dataclasses.dataclass(frozen=True)
class PostPlan:
    """What to expect of a picture by post-processing.

    Attributes:
        taps: places to look at per pixel.
        decibels: expected PSNR against the picture of very many rays, for a peak of 1.
        at_least: the PSNR that it has but for one case of forty.
        reaches: whether that is what was wanted.
        seconds: that `post_process` takes, programs being compiled.
        fewest_seconds: that `render` would take with the fewest rays a pixel.
    """

    taps: int
    decibels: float
    at_least: float
    reaches: bool
    seconds: float
    fewest_seconds: float


def plan_post(
    view: PinholeView,
    layers: Layers,
    lens: AbstractLens,
    quality: str | float,
    *,
    taps: int = PLACES,
    seed: int = 0,
) -> PostPlan:
    """Whether `post_process` can be expected to reach a quality.

    The picture is made, and some of its pixels are traced to estimate its error (`estimate_quality`). The
    quality counts as reached only if the error with two of its standard errors is small enough, so that no
    picture is taken that was merely lucky in its pixels.

    Args:
        view: what a pinhole sees; nothing in it moves.
        layers: of the same frame, peeled for the lens.
        lens: any lens.
        quality: as for `plan_rays`.
        taps: as for `post_process`.
        seed: chooses pixels and rays of the trial.

    Raises:
        ValueError: no such quality; a view that moves, which layers of one moment do not hold; or as
            `post_process` and `estimate_quality`.

    Example:
        >>> plan = plan_post(view_in_layers(layers, scene), layers, lens, "draft")  # doctest: +SKIP
        >>> image = post_process(view, layers.camera, lens, taps=plan.taps)  # doctest: +SKIP
    """
    wanted = decibels_of(quality)
    require_counts(taps=taps)
    seed = require_seed(seed)
    if view.velocity is not None:
        raise ValueError("the view has velocities, but layers are of one moment; leave its velocities out")
    # For its programs to be compiled.
    jax.block_until_ready(post_process(view, layers.camera, lens, taps=taps))
    start = time.perf_counter()
    picture = np.asarray(post_process(view, layers.camera, lens, taps=taps))
    seconds = time.perf_counter() - start
    found = estimate_quality(layers, lens, picture, seed=seed)
    return PostPlan(
        taps, found.decibels, found.at_least, found.at_least >= wanted, seconds, found.fewest_seconds
    )
