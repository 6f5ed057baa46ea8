"""From wishes to a lens: weighted least squares in focus disparity and aperture radius."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool

from focusjax.focus._bounds import Limits, make_limits
from focusjax.focus._checks import require
from focusjax.focus._global import find_optimum
from focusjax.focus._image_points import ImagePoints, blurs, errors
from focusjax.focus._refine import METHODS, Problem
from focusjax.focus._solution import Result, Solution
from focusjax.geometry import Camera
from focusjax.lens import ThinLens


def solve(
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens,
    *,
    free: tuple[str, ...] = ("focus",),
    min_focus_distance: ArrayLike | None = None,
    max_focus_distance: ArrayLike = jnp.inf,
    f_number_range: tuple[ArrayLike, ArrayLike] = (1.0, 32.0),
    method: str = "optimistix",
    max_steps: int = 256,
    throw: bool = True,
) -> Solution:
    """The lens that meets the wishes best.

    Minimises the sum of weight x (error in pixels)^2 over the focus disparity, and over the aperture
    radius too when the f-number is free, within bounds. The error is linear in the focus disparity,
    and in (E, E w_f) jointly, so that the optimum over all sides that unsigned wishes can choose is
    found exactly (`find_optimum`): no start leads to a worse one. Least squares on the face of the
    bounds that are active then refine it, and make the solution differentiable, by the implicit
    function theorem, in the points, the camera, the bounds and whatever of the lens is not solved for.

    What the wishes leave open stays as the starting lens has it: the f-number when all wishes are at
    one distance, the focus of a pinhole. `Solution.undetermined` names it. Where two solutions are
    equally good, the nearer focus is taken.

    Args:
        points: located wishes; at least one has positive weight.
        camera: the pinhole that frames the picture.
        lens: where to start, and the values of what is not free.
        free: parameters to solve for: ("focus",) or ("focus", "f_number").
        min_focus_distance: metres, more than the focal length; twice the focal length when not given.
        max_focus_distance: metres, or infinity.
        f_number_range: smallest and largest f-number; used only when the f-number is free.
        method: "optimistix" (Levenberg-Marquardt), or "jaxopt" (L-BFGS-B from the starting lens, as an
            independent check: slower, less exact and not differentiable).
        max_steps: steps allowed.
        throw: raise an error, rather than report it in `Solution.result`, when the solver fails.

    Raises:
        ValueError: an argument out of range, or no point with positive weight.
        RuntimeError: the solver failed, and `throw` is true.

    Example:
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> points = locate([FocusPoint(AtPoint((0, 0, -2)), Sharp())], camera)
        >>> round(float(solve(points, camera, start).lens.focus_distance()), 6)
        2.0
    """
    if set(free) not in ({"focus"}, {"focus", "f_number"}):
        raise ValueError(f"free parameters are {list(free)}; expected ['focus'] or ['focus', 'f_number']")
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; expected one of {list(METHODS)}")
    limits = make_limits(
        camera,
        min_focus_distance=min_focus_distance,
        max_focus_distance=max_focus_distance,
        f_number_range=f_number_range,
    )
    points = checked_points(points)
    free_aperture = "f_number" in free
    if free_aperture:
        _check_start(camera, lens, limits)
    # Names are static: without them, other names do not compile the solver again.
    anonymous = dataclasses.replace(points, names=())
    solution, failed = _solve(anonymous, camera, lens, limits, free_aperture, method, max_steps)
    solution = dataclasses.replace(solution, points=points)
    # A known success skips the machinery of errors inside compiled code.
    if throw and (isinstance(failed, Tracer) or bool(failed)):
        solution = solution.result.error_if(solution, failed)
    return solution


@eqx.filter_jit
def _solve(
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens,
    limits: Limits,
    free_aperture: bool,
    method: str,
    max_steps: int,
) -> tuple[Solution, Bool[Array, ""]]:
    """The compiled part: settle sides and active bounds, refine, report; and whether that failed."""
    box = limits.box(camera) if free_aperture else limits.box(camera).at_radius(lens.aperture_radius)
    start = jnp.stack([jnp.clip(lens.focus_disparity, box.lower[0], box.upper[0]), lens.aperture_radius])
    optimum = jax.lax.stop_gradient(
        find_optimum(points, 2.0 * camera.focal_px, start, box, free_aperture=free_aperture)
    )
    problem = Problem(points, camera, lens, optimum.side * points.target)
    value, steps, result = METHODS[method](problem, optimum, start, box, max_steps)
    # Rounding may carry a free parameter past a bound that it reaches without being pushed.
    value = value + jax.lax.stop_gradient(jnp.clip(value, box.lower, box.upper) - value)
    solved = problem.lens_at(value)
    error = errors(points, camera, solved)
    result = Result.where((result == Result.solved) & jnp.any(optimum.held), Result.undetermined, result)
    result = Result.where(jnp.all(jnp.isfinite(error)), result, Result.not_finite)
    solution = Solution(
        lens=solved,
        points=points,
        blur=blurs(points, camera, solved),
        error=error,
        cost=0.5 * jnp.sum(points.weight * error**2),
        result=result,
        steps=steps,
        at_lower=optimum.at_lower,
        at_upper=optimum.at_upper,
        held=optimum.held,
    )
    return solution, (result == Result.max_steps_reached) | (result == Result.not_finite)


def _check_start(camera: Camera, lens: ThinLens, limits: Limits) -> None:
    """Refuses a starting f-number outside the range, which a silent clamp would hide."""
    number = lens.f_number(camera)
    # An end of the range must not be refused for the last bit of its reciprocal.
    slack = 1.0 + 8.0 * float(jnp.finfo(number.dtype).eps)
    require(
        number,
        lambda v: (v * slack >= limits.widest) & (v <= limits.narrowest * slack),
        "the starting f-number",
        "a value in the f-number range; change one of them",
    )


def checked_points(points: ImagePoints) -> ImagePoints:
    """The points, with every value in range."""
    if points.disparity.shape[0] == 0:
        raise ValueError("there are no focus points; give at least one wish")
    weight = require(
        points.weight,
        lambda v: (v >= 0) & (v < np.inf),
        "a focus point's weight",
        "zero or a positive finite number",
    )
    weight = require(
        weight, lambda v: (v > 0).any(), "every focus point's weight", "at least one that is positive"
    )
    disparity = require(
        points.disparity,
        lambda v: (v >= 0) & (v < np.inf),
        "a focus point's disparity",
        "0 (infinity) or a positive finite number of dioptres",
    )
    target = require(
        points.target,
        lambda v: (abs(v) < np.inf) & (points.signed | (v >= 0)),
        "a focus point's wished blur",
        "a finite number of pixels, negative only when signed",
    )
    return dataclasses.replace(points, weight=weight, disparity=disparity, target=target)
