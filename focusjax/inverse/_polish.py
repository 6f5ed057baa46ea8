"""Last steps of a fit, on single pixels.

A derivative at a point is as noisy as its rays are few, pixel by pixel, and noise in slopes makes steps too
short. Secants over a part of a pixel of blur, by the same rays at both ends, have next to none.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float

from focusjax.inverse._levels import Problem
from focusjax.trace import check_reach, render, widest_opening

_SMALL = 0.1
"""Squares of standard errors, per setting, that a step may be and not be made."""
_SERVED = 1.0 - 1e-6


@dataclasses.dataclass(frozen=True)
class Polished:
    """Where the last steps ended.

    Attributes:
        settings: of the lens [p].
        residual: picture less target [h, w, 3].
        slopes: of the picture by the free settings [h, w, 3, k].
        steps: how many there were.
        converged: whether the next one would be small against standard errors.
    """

    settings: np.ndarray
    residual: np.ndarray
    slopes: np.ndarray
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
    width = problem.variables.secants(settings, problem.layers.camera)
    slopes = _slopes(problem, settings, width)
    rows = (np.sqrt(weight)[..., None] * slopes).reshape(-1, len(columns))
    inverse, at = np.linalg.pinv(rows), settings
    steps, converged = 0, False
    while True:
        residual = _picture(problem, settings, exact) - target
        step = -(inverse @ (np.sqrt(weight) * residual).reshape(-1))
        noise = float((weight * residual**2).sum()) / max(int((weight > 0).sum()), 1)
        converged = float(((rows @ step) ** 2).sum()) <= _SMALL * len(columns) * noise
        if converged or steps == most_steps:
            break
        settings = problem.variables.within(_moved(settings, columns, step, width), problem.layers)
        steps += 1
        if (np.abs(settings - at)[columns] > width[columns]).any():
            slopes = _slopes(problem, settings, width)
            rows = (np.sqrt(weight)[..., None] * slopes).reshape(-1, len(columns))
            inverse, at = np.linalg.pinv(rows), settings
    return Polished(settings, residual, slopes, steps, converged)


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
    check_reach(problem.layers, lens)
    if exact is None:
        picture = np.asarray(render(problem.layers, lens, rays=problem.rays, even=True, seed=problem.seed))
    else:
        picture = np.asarray(exact(lens))
        if picture.shape != problem.target.shape or not np.isfinite(picture).all():
            raise ValueError(
                f"the exact picture has shape {picture.shape} or is not finite; expected"
                f" {problem.target.shape}, linear RGB through the lens that is asked for"
            )
    return settings[-1] * picture.astype(np.float64)


def _slopes(problem: Problem, settings: np.ndarray, width: np.ndarray) -> Float[np.ndarray, "h w 3 k"]:
    """Secants over settings less and more `width`, or on one side where layers do not serve the other."""
    slopes = []
    for column in problem.variables.columns:
        ends = []
        for side in (-1.0, 1.0):
            moved = settings.copy()
            moved[column] += side * width[column]
            lens = problem.variables.lens_at(jnp.asarray(moved, dtype=problem.target.dtype))
            ends.append(moved if float(widest_opening(problem.layers, lens)) > _SERVED else settings)
        low, high = ends
        apart = high[column] - low[column]
        change = _picture(problem, high, None) - _picture(problem, low, None)
        slopes.append(change / apart if apart else np.zeros_like(change))
    return np.stack(slopes, axis=-1)
