"""The lens that made a picture of a known scene."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from focusjax._arguments import require_switches
from focusjax._counts import require_counts, require_seed
from focusjax.inverse._coarse_to_fine import coarse_to_fine, rms
from focusjax.inverse._image_fit import ImageFit, Level, standard_errors
from focusjax.inverse._levels import Problem
from focusjax.inverse._polish import Polished
from focusjax.inverse._scan import Scan, check_scan, scan_lenses
from focusjax.inverse._search import best_starts
from focusjax.inverse._target import checked_mask, checked_target, weights
from focusjax.inverse._variables import GAIN, RADIUS, Variables, in_order, make_variables
from focusjax.layers import Layers
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.trace import check_reach

_STARTS = 2
"""Starts of a search that are followed over the coarsest blocks."""
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
    scan: Scan | None = None,
    exact: Callable[[ThinLens | TiltShiftLens], ArrayLike] | None = None,
    min_focus_distance: float | None = None,
    rays: int = 64,
    seed: int = 0,
    max_steps: int = 16,
) -> ImageFit:
    """The lens whose picture of `layers` is most like `target`.

    Least squares over all pixels by Levenberg and Marquardt's method (Optimistix), with the picture's true
    derivatives (`render`), which know what appears and disappears behind silhouettes. Coarse
    to fine: means over 8 x 8 pixels, over 2 x 2, then single pixels, each of which counts by how well those
    around it were met before: noise is largest along blurred silhouettes, and so are errors of the model.

    The lens is sought among those that the layers serve: those whose rays go no farther than the rays of the
    lens that was peeled for. Peel for `widest_lens(...)`, which serves every focus from a least distance to
    infinity at every opening up to a widest one. Layers of an ordinary lens hold the lenses of the same or a
    smaller opening whose focus is near its own; how near, the margin decides. `ImageFit.at_limits` names
    the parameters whose best value would lie beyond.

    Pictures of layers are true to a share of a sample, which `exact` takes away for pictures that are not
    made of the same layers.

    Args:
        target: linear picture [h, w, 3] of the size of the layers' camera.
        layers: the known scene, peeled from where the picture was taken.
        lens: where to start, and the values of what is not free.
        free: parameters to find, of "focus", "f_number", "tilt", "swing" and "gain" (a factor on the
            picture; 1 if not free). With tilt or swing free, a thin lens becomes a tilt-shift lens.
        mask: pixels [h, w] that count, all if not given. For what the layers do not have, such as people.
        noise: standard deviation of the target's values, one number or [h, w] or [h, w, 3], up to a common
            factor; found from the residuals around each pixel if not given.
        robust: let values that stand out of the rest count less: Huber's weights, from the residuals of each
            level for the next one, and a last time for single pixels.
        search: compare the target with pictures of few rays of lenses all over the range first, and start
            from the best two. Otherwise start from `lens` alone.
        scan: those pictures, of `scan_lenses` with the same layers and what is free here, for several
            targets to share; made if not given.
        exact: another renderer of the scene, without layers, such as
            `lambda lens: lens_picture(scene, camera, lens, rays=256)` of `focusjax.baselines`. Last steps
            are made with its pictures and our slopes.
        min_focus_distance: metres; 0.8 times the distance of the nearest surface in sight if not given.
        rays: rays per pixel.
        seed: chooses the rays.
        max_steps: steps allowed on each level.

    Raises:
        ValueError: a target of another size, of display codes (those of 8 bits are recognised), not finite
            or of no light; no free parameter or an unknown one; a pinhole to focus; a picture that does not
            depend on a free one; layers that do not hold the rays of `lens` where its opening is not free; a
            scan of other layers; an exact picture of another size.

    Example:
        >>> fit = fit_image(photograph, layers, lens, free=("focus", "f_number", "gain"))  # doctest: +SKIP
        >>> float(fit.lens.focus_distance()), float(fit.lens.f_number(camera))  # doctest: +SKIP
    """
    require_counts(rays=rays, max_steps=max_steps)
    seed = require_seed(seed)
    require_switches(robust=robust, search=search)
    free = in_order(free)
    if not isinstance(lens, ThinLens | TiltShiftLens):
        raise ValueError(f"lens is a {type(lens).__name__}; expected a ThinLens or a TiltShiftLens")
    if "f_number" not in free and set(free) != {"gain"} and not float(lens.aperture_radius) > 0:
        raise ValueError(
            "the lens is a pinhole, whose picture is the same at any focus; open its aperture, or let"
            " f_number be free"
        )
    picture = checked_target(target, layers.camera, mask)
    counts = checked_mask(mask, layers.camera)
    weight = weights(counts, noise, picture.shape)
    real = layers.background.dtype
    like = jnp.asarray(picture, dtype=real)
    if "f_number" not in free:
        check_reach(layers, lens)
    variables = make_variables(layers, lens, free, min_focus_distance, like)
    problem = Problem(layers, variables, like, jnp.asarray(weight, dtype=real), rays, seed)
    if search:
        scan = scan_lenses(layers, lens, free=free, seed=seed) if scan is None else scan
        check_scan(scan, layers, free)
        starts = best_starts(problem, variables, scan, _STARTS)
    else:
        starts = [(variables.start(layers), 0.0)]
    found, last, levels = coarse_to_fine(
        problem,
        starts,
        weight,
        max_steps,
        searched=search,
        even=noise is None,
        robust=robust,
        exact=exact,
    )
    return _answer(problem, variables, last, found, levels)


def _answer(
    problem: Problem, variables: Variables, last: Problem, found: Polished, levels: list[Level]
) -> ImageFit:
    """The report on a fit, or a refusal.

    Raises:
        ValueError: the picture does not depend on a free parameter, or its opening had to be closed.
    """
    layers, real = problem.layers, problem.target.dtype
    residual, slopes, weight = found.residual, found.slopes, np.asarray(last.weight)
    settings = jnp.asarray(found.settings, dtype=real)
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
    lens = variables.lens_at(settings)
    check_reach(layers, lens)
    limits = variables.at_limits(settings, layers)
    return ImageFit(
        lens=lens,
        gain=float(found.settings[GAIN]),
        picture=problem.target + jnp.asarray(residual, dtype=real),
        rms_error=rms(residual, np.asarray(problem.weight)),
        standard_errors=standard_errors(variables, found, layers.camera, weight),
        at_limits=tuple(name for name, at in zip(variables.free, limits, strict=True) if at),
        levels=tuple(levels),
        steps=sum(level.steps for level in levels),
        converged=levels[-1].converged,
    )
