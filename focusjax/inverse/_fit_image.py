"""The lens that made a picture of a known scene."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._counts import require_counts
from focusjax.inverse._blocks import SIZES
from focusjax.inverse._image_fit import ImageFit, Level, standard_errors
from focusjax.inverse._levels import Found, Problem, fit_level
from focusjax.inverse._search import best_starts
from focusjax.inverse._sight import nearest_in_sight
from focusjax.inverse._target import checked_mask, checked_target, weights
from focusjax.inverse._variables import GAIN, RADIUS, in_order, make_variables
from focusjax.layers import Layers
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.trace import check_reach

_STARTS = 2
"""Starts of a search that are followed down to single pixels."""
_HUBER = 1.345
"""Robust standard deviations beyond which residuals count linearly: 95 % efficient on normal ones."""
_FLAT = 1e-6
"""Share of the target's contrast; slopes over the whole range of a parameter below it are none."""


def fit_image(
    target: ArrayLike,
    layers: Layers,
    lens: ThinLens | TiltShiftLens,
    *,
    free: tuple[str, ...] = ("focus", "f_number"),
    mask: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    robust: bool = False,
    search: bool = True,
    min_focus_distance: float | None = None,
    rays: int = 64,
    seed: int = 0,
    max_steps: int = 16,
) -> ImageFit:
    """The lens whose picture of `layers` is most like `target`.

    Least squares over all pixels by Levenberg and Marquardt's method (Optimistix), with the picture's true
    derivatives (`render_differentiable`), which know what appears and disappears behind silhouettes. Coarse
    to fine: means over 8 x 8 pixels, over 2 x 2, then single pixels.

    The lens is sought among those that the layers serve: those whose rays go no farther than the rays of the
    lens that was peeled for. Peel for `widest_lens(...)`, which serves every focus from a least distance to
    infinity at every opening up to a widest one. Layers of an ordinary lens hold the lenses of the same or a
    smaller opening whose focus is near its own; how near, the margin decides. `ImageFit.at_limits` tells when
    the best lens would lie beyond.

    Args:
        target: linear picture [h, w, 3] of the size of the layers' camera.
        layers: the known scene, peeled from where the picture was taken.
        lens: where to start, and the values of what is not free.
        free: parameters to find, of "focus", "f_number", "tilt", "swing" and "gain" (a factor on the
            picture; 1 if not free). With tilt or swing free, a thin lens becomes a tilt-shift lens.
        mask: pixels [h, w] that count, all if not given. For what the layers do not have, such as people.
        noise: standard deviation of the target's values, one number or [h, w] or [h, w, 3], up to a common
            factor; all alike if not given.
        robust: let values that stand out of the rest count less: Huber's weights, from the residuals of each
            level for the next one, and a last time for single pixels.
        search: try many lenses all over the range with few rays first, and start from the best two. Otherwise
            start from `lens` alone.
        min_focus_distance: metres; 0.8 times the distance of the nearest surface in sight if not given.
        rays: rays per pixel.
        seed: chooses the rays.
        max_steps: steps allowed on each level.

    Raises:
        ValueError: a target of another size, in display encoding or not finite; no free parameter or an
            unknown one; a picture that does not depend on a free one; layers that do not hold the rays of
            `lens` where its opening is not free.

    Example:
        >>> fit = fit_image(photograph, layers, lens, free=("focus", "f_number", "gain"))  # doctest: +SKIP
        >>> float(fit.lens.focus_distance()), float(fit.lens.f_number(camera))  # doctest: +SKIP
    """
    require_counts(rays=rays, max_steps=max_steps)
    free = in_order(free)
    if not isinstance(lens, ThinLens | TiltShiftLens):
        raise ValueError(f"lens is a {type(lens).__name__}; expected a ThinLens or a TiltShiftLens")
    picture = checked_target(target, layers.camera, mask)
    counts = checked_mask(mask, layers.camera)
    weight = weights(counts, noise, picture.shape)
    if not (np.ptp(picture[counts], axis=0) > 0).any():
        raise ValueError("the target is the same everywhere, so that it tells nothing of the lens")
    real = layers.background.dtype
    like = jnp.asarray(picture, dtype=real)
    if "f_number" not in free:
        check_reach(layers, lens)
    variables = make_variables(layers, lens, free, min_focus_distance, like)
    problem = Problem(layers, variables, like, jnp.asarray(weight, dtype=real), rays, seed)
    own = variables.start(layers)
    if search:
        seen = nearest_in_sight(layers)[counts]
        starts = best_starts(problem, seen, own, _STARTS)
    else:
        starts = [own]
    found, last, levels = _coarse_to_fine(problem, starts, weight, robust, max_steps)
    return _answer(problem, last, found, levels)


def _coarse_to_fine(
    problem: Problem,
    starts: Sequence[Float[Array, " k"]],
    weight: np.ndarray,
    robust: bool,
    max_steps: int,
) -> tuple[Found, Problem, list[Level]]:
    """The best fit to single pixels, with the problem (its weights) that it solves, and how it went."""
    rounds = [*range(len(SIZES)), len(SIZES) - 1] if robust else [*range(len(SIZES))]
    best: tuple[Found, Problem, list[Level]] | None = None
    for start in starts:
        value, now, levels = start, problem, []
        for number, level in enumerate(rounds):
            found = fit_level(now, value, jnp.array(level), most_steps=max_steps)
            value = found.variables
            error = _rms(np.asarray(found.residual), weight)
            levels.append(Level(SIZES[level], int(found.steps), error, bool(found.converged)))
            if robust and number + 1 < len(rounds):
                now = _reweighted(problem, np.asarray(found.residual), weight)
        if best is None or levels[-1].rms_error < best[2][-1].rms_error:
            best = found, now, levels
    assert best is not None
    return best


def _reweighted(problem: Problem, residual: np.ndarray, weight: np.ndarray) -> Problem:
    """The problem with Huber's weights for a residual."""
    size = np.sqrt(weight) * np.abs(residual)
    spread = 1.4826 * float(np.median(size[weight > 0]))
    factor = np.where(size > _HUBER * spread, _HUBER * spread / np.where(size > 0, size, 1.0), 1.0)
    return Problem(
        problem.layers,
        problem.variables,
        problem.target,
        jnp.asarray(weight * factor, dtype=problem.weight.dtype),
        problem.rays,
        problem.seed,
    )


def _answer(problem: Problem, last: Problem, found: Found, levels: list[Level]) -> ImageFit:
    """The report on a fit, or a refusal.

    Raises:
        ValueError: the picture does not depend on a free parameter, or its opening had to be closed.
    """
    variables, layers = problem.variables, problem.layers
    residual, slopes, weight = (np.asarray(a) for a in (found.residual, found.slopes, last.weight))
    span = np.asarray(variables.upper - variables.lower)[list(variables.columns)]
    effect = np.sqrt(np.einsum("hwc,hwck->k", weight, slopes**2)) * span
    flat = [name for name, e in zip(variables.free, effect, strict=True) if not e > _FLAT * last.contrast()]
    if flat:
        raise ValueError(
            f"the picture does not depend on {' and '.join(flat)} where the fit ended, at f/"
            f"{float(layers.camera.focal_length / (2 * found.settings[RADIUS])):.4g}; leave that out of free,"
            " start from a wider opening, or let pixels count that show it"
        )
    if "f_number" not in variables.free and not np.isclose(
        float(found.settings[RADIUS]), float(variables.lens.aperture_radius), rtol=1e-4
    ):
        raise ValueError(
            "the fit leads to a focus whose rays leave what the layers were peeled for; peel for"
            " widest_lens(...), or narrow the range by min_focus_distance"
        )
    lens = variables.lens_at(found.settings)
    check_reach(layers, lens)
    limits = variables.at_limits(found.variables)
    return ImageFit(
        lens=lens,
        gain=float(found.settings[GAIN]),
        picture=problem.target + found.residual,
        rms_error=levels[-1].rms_error,
        standard_errors=standard_errors(variables, found.settings, layers.camera, residual, slopes, weight),
        at_limits=tuple(name for name, at in zip(variables.free, limits, strict=True) if at),
        levels=tuple(levels),
        steps=sum(level.steps for level in levels),
        converged=levels[-1].converged,
    )


def _rms(residual: np.ndarray, weight: np.ndarray) -> float:
    """Root mean square by weight, of values that count."""
    return float(np.sqrt((weight * residual.astype(np.float64) ** 2).sum() / weight.sum()))
