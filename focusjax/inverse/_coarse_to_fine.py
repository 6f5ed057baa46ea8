"""A fit over blocks of pixels, from large ones to single pixels."""

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax.inverse._blocks import SIZES
from focusjax.inverse._image_fit import Level
from focusjax.inverse._levels import Problem, fit_level
from focusjax.inverse._polish import Polished, polished
from focusjax.inverse._weights import by_size, by_spread

_SHARE = 4
"""Of the rays of the last steps that those over blocks have one: blocks average noise."""
_AFTER_SEARCH = 5
"""Steps on each level over blocks from starts that a search found: there is not far to go."""
_RIVAL = 2.0
"""How many times the least cost another start may have and be followed, too."""


def coarse_to_fine(
    problem: Problem,
    starts: Sequence[tuple[Float[Array, " k"], float]],
    weight: np.ndarray,
    max_steps: int,
    *,
    searched: bool,
    even: bool,
    robust: bool,
    exact: Callable[[Any], ArrayLike] | None,
) -> tuple[Polished, Problem, list[Level]]:
    """The best fit to single pixels, with the problem (its weights) that it solves, and how it went.

    Args:
        problem: what to fit.
        starts: variables, and what the picture differs by; the least first.
        weight: of each value of the target.
        max_steps: of each level.
        searched: whether the starts are near.
        even: whether nothing is known of the noise; weights are then found on the way.
        robust: whether values that stand out count less.
        exact: renderer of the last steps; that of the layers if None.
    """
    coarse = problem.of_rays(max(1, problem.rays // _SHARE))
    few = jnp.array(min(max_steps, _AFTER_SEARCH) if searched else max_steps)
    rivals = [start for start, cost in starts if cost <= _RIVAL * starts[0][1]]
    tried = (fit_level(coarse, start, jnp.array(0), few) for start in rivals)
    found = min(tried, key=lambda each: float(each.cost))
    levels = []
    for number, size in enumerate(SIZES):
        if number > 0:
            counted = by_size(weight, np.asarray(found.residual)) if robust else weight
            level = jnp.array(number)
            found = fit_level(coarse.weighed(counted), found.variables, level, few)
        error = rms(np.asarray(found.residual), weight)
        levels.append(Level(size, int(found.steps), error, bool(found.converged)))
    residual, settings = np.asarray(found.residual), np.asarray(found.settings)
    # Weights are found anew once the fit is near.
    again = [None] if even or robust else []
    rounds = [None, *again, *([exact] if exact is not None else [])]
    for renderer in rounds:
        counted = by_spread(weight, residual, float(problem.contrast())) if even else weight
        now = problem.weighed(by_size(counted, residual) if robust else counted)
        end = polished(now, settings, renderer, most_steps=max_steps)
        levels.append(Level(1, end.steps, rms(end.residual, weight), end.converged))
        residual, settings = end.residual, end.settings
    return end, now, levels


def rms(residual: np.ndarray, weight: np.ndarray) -> float:
    """Root mean square by weight, of values that count."""
    return float(np.sqrt((weight * residual.astype(np.float64) ** 2).sum() / weight.sum()))
