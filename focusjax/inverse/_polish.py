"""Last steps of a fit, on single pixels.

A derivative at a point is as noisy as its rays are few, pixel by pixel. Secants over a part of a pixel of
blur, by the same rays at both ends, have much less noise. What is left would make steps too short, as squares
of it add to the squares of slopes, so that slopes are taken twice, by different rays, J and K: the step
solves (J' W K + K' W J) / 2 d = -(J + K)' W r / 2, in which no noise meets itself. Where steps are too
long nevertheless, each turns back from the one before: then half as much is taken, and more again afterwards.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float

from focusjax._counts import later_seed
from focusjax.inverse._levels import Problem
from focusjax.inverse._sight import served_share
from focusjax.trace import check_reach, render

_SMALL = 2.0
"""Squares of standard errors, per setting, that a step may be and be the last: it is nearly right."""
_MORE = 4
"""Times the rays, for slopes that exact pictures are compared with."""
_FAR = 0.5
"""Of the length of secants, beyond which they are taken anew."""
_LEAST = 0.25
"""The least share of a step that is taken."""
_CERTAIN = 1e-5
"""Least eigenvalue, of the products of slopes of unit length, whose direction counts as determined."""
_APART = (32, 48)
"""Of the seeds of slopes from that of the picture: their noise must not be that of the residual."""
_SERVED = 1.0 - 1e-6


@dataclasses.dataclass(frozen=True)
class Polished:
    """Where the last steps ended.

    Attributes:
        settings: of the lens [p].
        residual: picture less target [h, w, 3]; with an exact renderer, to first order in the last step.
        slopes: of the picture by the free settings [h, w, 3, k].
        square: sums of products of slopes by different rays [k, k], by weight.
        steps: how many there were.
        converged: whether the next one would be small against standard errors.
    """

    settings: np.ndarray
    residual: np.ndarray
    slopes: np.ndarray
    square: np.ndarray
    steps: int
    converged: bool


def polished(
    problem: Problem,
    settings: Float[np.ndarray, " p"],
    exact: Callable[[Any], ArrayLike] | None,
    *,
    most_steps: int,
) -> Polished:
    """Gauss and Newton's method from `settings`, with secants of pictures of the layers.

    With `exact`, residuals are of its pictures. What layers get wrong is nearly the same for lenses that
    are nearly the same, so that their slopes will do, and the zero of slopes times exact residual has no
    error of theirs.

    Raises:
        ValueError: an exact picture of another size or not finite, or steps beyond what the layers hold.
    """
    columns = list(problem.variables.columns)
    weight, target = (np.asarray(a, dtype=np.float64) for a in (problem.weight, problem.target))
    settings = np.asarray(settings, dtype=np.float64)
    # One slope for several of the exact pictures, which cost the most, but a good one.
    sloped = problem if exact is None else problem.of_rays(_MORE * problem.rays)
    width = problem.variables.secants(settings, problem.layers.camera)
    (slopes, square), at = _slopes(sloped, settings, width), settings
    steps, share, last = 0, 1.0, np.zeros(len(columns))
    while True:
        steps += 1
        if (np.abs(settings - at)[columns] > _FAR * width[columns]).any():
            width = problem.variables.secants(settings, problem.layers.camera)
            (slopes, square), at = _slopes(sloped, settings, width), settings
        residual = _picture(problem, settings, exact) - target
        step = -inverse_of(square) @ np.einsum("hwck,hwc->k", slopes, weight * residual)
        noise = float((weight * residual**2).sum()) / max(int((weight > 0).sum()), 1)
        converged = float(step @ square @ step) <= _SMALL * len(columns) * noise
        # A step back says that the last one went too far.
        turned = float(step @ square @ last) < 0
        share = 1.0 if converged else max(share / 2, _LEAST) if turned else min(2 * share, 1.0)
        before = settings
        settings = problem.variables.within(_moved(settings, columns, share * step, width), problem.layers)
        last = (settings - before)[columns]
        residual += slopes @ last
        if converged or steps >= most_steps:
            break
    if exact is None:
        residual = _picture(problem, settings, None) - target
    return Polished(settings, residual, slopes, square, steps, converged)


def inverse_of(square: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """Of what slopes say for certain; nothing in directions that they leave open."""
    known = np.diag(square) > 0
    units = np.sqrt(np.where(known, np.diag(square), 1.0))
    values, vectors = np.linalg.eigh(np.where(np.outer(known, known), square, 0.0) / np.outer(units, units))
    certain = values > _CERTAIN
    inverse = (vectors[:, certain] / values[certain]) @ vectors[:, certain].T
    return inverse / np.outer(units, units)


def _moved(settings: np.ndarray, columns: list[int], step: np.ndarray, width: np.ndarray) -> np.ndarray:
    """A step, shortened as a whole where it goes farther than slopes are to be trusted."""
    out = settings.copy()
    out[columns] += step / max(1.0, float(np.max(np.abs(step) / (4.0 * width[columns]))))
    return out


def _picture(
    problem: Problem, settings: np.ndarray, exact: Callable[[Any], ArrayLike] | None
) -> Float[np.ndarray, "h w 3"]:
    """Through the lens of given settings, times the gain."""
    lens = problem.variables.lens_at(jnp.asarray(settings, dtype=problem.target.dtype))
    if exact is None:
        picture = np.asarray(render(problem.layers, lens, rays=problem.rays, even=True, seed=problem.seed))
    else:
        check_reach(problem.layers, lens)
        picture = np.asarray(exact(lens))
        if picture.shape != problem.target.shape or not np.isfinite(picture).all():
            raise ValueError(
                f"the exact picture has shape {picture.shape} or is not finite; expected"
                f" {problem.target.shape}, linear RGB through the lens that is asked for"
            )
    return settings[-1] * picture.astype(np.float64)


def _slopes(
    problem: Problem, settings: np.ndarray, width: np.ndarray
) -> tuple[Float[np.ndarray, "h w 3 k"], Float[np.ndarray, "k k"]]:
    """Secants over settings less and more `width`, and sums of products of those by different rays."""
    half = problem.of_rays(max(1, problem.rays // 2))
    one, other = (_secants(half.of_seed(later_seed(problem.seed, k)), settings, width) for k in _APART)
    product = np.einsum("hwcj,hwc,hwck->jk", one, np.asarray(problem.weight, dtype=np.float64), other)
    return 0.5 * (one + other), 0.5 * (product + product.T)


def _secants(problem: Problem, settings: np.ndarray, width: np.ndarray) -> Float[np.ndarray, "h w 3 k"]:
    """On one side only where layers do not serve the other."""
    slopes = []
    for column in problem.variables.columns:
        ends = []
        for side in (-1.0, 1.0):
            moved = settings.copy()
            moved[column] += side * width[column]
            lens = problem.variables.lens_at(jnp.asarray(moved, dtype=problem.target.dtype))
            ends.append(moved if float(served_share(problem.layers, lens)) > _SERVED else settings)
        low, high = ends
        apart = high[column] - low[column]
        change = _picture(problem, high, None) - _picture(problem, low, None)
        slopes.append(change / apart if apart else np.zeros_like(change))
    return np.stack(slopes, axis=-1)
