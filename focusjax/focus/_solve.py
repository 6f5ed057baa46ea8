"""From wishes to a lens: weighted least squares over the parameters that are free."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool

from focusjax._arguments import ArgumentError, about, require_switches
from focusjax._counts import require_counts
from focusjax._programs import jit, jit_in_haste
from focusjax._words import kind_of
from focusjax.focus._basin import basin_of, ended, place_of
from focusjax.focus._bounds import Range, make_limits, refuse_idle
from focusjax.focus._image_points import ImagePoints, anonymous, blurs, errors, named_like, padded, room_for
from focusjax.focus._objective import make_objective
from focusjax.focus._parameters import in_order, reframes
from focusjax.focus._priors import Prior, checked_priors
from focusjax.focus._refine import Problem, refined
from focusjax.focus._refuse import (
    check_start,
    checked_close_focus,
    checked_glass,
    checked_points,
    refuse_glass,
    require_lens,
    require_points,
)
from focusjax.focus._solution import Asked, Plan, Result, Solution, first_rows
from focusjax.focus._solve_glass import solve_through
from focusjax.geometry import Camera
from focusjax.lens import (
    CloseFocus,
    FittedLens,
    PrescriptionLens,
    SpectralLens,
    ThinLens,
    TiltedPrescriptionLens,
    TiltShiftLens,
    require_close_focus,
)

Glass: TypeAlias = PrescriptionLens | SpectralLens | FittedLens | TiltedPrescriptionLens


def solve(
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    *,
    through: Glass | None = None,
    free: str | Sequence[str] = ("focus",),
    min_focus_distance: ArrayLike | None = None,
    max_focus_distance: ArrayLike | None = None,
    f_number_range: Range | None = None,
    tilt_range: Range | None = None,
    swing_range: Range | None = None,
    focal_length_range: Range | None = None,
    shift_range: Range | None = None,
    rise_range: Range | None = None,
    keep_field_of_view: bool = False,
    priors: Mapping[str, Prior] | None = None,
    close_focus: CloseFocus = "ignored",
    solver: Any = None,
    max_steps: int = 256,
    throw: bool = True,
) -> Solution:
    """The lens that meets the wishes best.

    Minimises the sum of weight x (error in pixels)^2, and of squared priors, over the free parameters
    within bounds. Where only the focus, or focus and f-number, are free and blurs are wished, the
    optimum over all sides that unsigned wishes can choose is found exactly (`find_optimum`), so no start
    leads to a worse one. All else is searched from a fixed list of starts (`search`), each of which is a
    convex problem. Least squares on the face of the bounds that are active then refine it, and make the
    solution differentiable, by the implicit function theorem, in the points, the camera, the bounds, the
    priors and whatever of the lens is not solved for.

    What the wishes leave open stays as the starting lens has it, or as near as the rest allows: of all
    settings that are equally good those are taken that change the picture least, each of them measured in
    pixels as `solve_frames` says, be it by wishes that any of several settings meet, by limits that are kept,
    or by sides of the focus. Of two that change it as much, within 1 %, the nearer focus is taken.
    `Solution.undetermined` names what is open. For focus and f-number of wishes at one distance that is
    exact; otherwise it is the nearest of the basins that the search finds (`nearest`).

    With `through` the blur is that of a real lens: its rays from every place are followed to the film, and
    the blur is sqrt(8 M), with M their mean square distance from their middle: for an ideal lens the diameter
    of the circle of confusion. It has the sign of its defocus, and where something is in focus it is the spot
    that aberrations leave, so a lens may miss a wish for sharpness however it is focused. The film moves as
    it does when the picture is made (Lee10 5.1).

    Args:
        points: located wishes; at least one has positive weight.
        camera: the pinhole that frames the picture.
        lens: where to start, and the values of what is not free. With tilt or swing free, a thin lens
            becomes a tilt-shift lens.
        through: the real lens that makes the picture, made for `camera` and as wide as it may open. Only
            "focus" and "f_number" can be free, and the f-number is no less than that of this lens.
            `Solution.glass` is the lens to use, and `Solution.lens` the ideal one with its settings.
        free: parameters to solve for, of "focus", "f_number", "tilt", "swing", "focal_length", "shift" and
            "rise"; limits may be given to these only. Shift and rise move the frame and change neither
            perspective nor blur: wishes for where things are shown (`ShownAt`, `InFrame`) determine them, and
            those for blur do not.
        min_focus_distance: metres along the view axis, more than the focal length; life size when not given,
            which is at twice the (longest) focal length, or for "framing" at the image distance.
        max_focus_distance: metres; infinity when not given.
        f_number_range: smallest and largest f-number; 1 to 32 when not given.
        tilt_range: least and largest tilt in radians, within -pi/2 to pi/2; 45 degrees both ways by default.
        swing_range: the same for the angle of the lens's axis to the right, which is the swing of a lens
            without tilt.
        focal_length_range: metres; needed when the focal length is free, which keeps the f-number.
        shift_range: least and largest shift in metres; half the sensor's width both ways when not given.
        rise_range: the same for the rise.
        keep_field_of_view: let the sensor grow with the focal length; the picture then stays as it is
            framed. Otherwise the focal length is a zoom.
        priors: expectations of free parameters, by name.
        close_focus: what stays as the focus moves: with "framing" the image distance, which `camera` then
            has, and with "breathing" the focal length, for which `camera` then is the one focused on
            infinity: `Solution.camera` is the one that frames the picture, and `points` are located in
            `camera`. F-numbers are those that are set (`Solution.settings`), and hold as the focus moves.
            Focus and f-number of a thin lens can be free, and only the f-number can have a prior.
        solver: of Optimistix, for least squares or minimisation, as `optimistix.Dogleg(1e-5, 1e-5)` or
            `focusjax.solvers.JaxoptLBFGSB()`: an independent check, which starts from the lens as given once
            sides and active bounds are found. `focusjax.solvers.BoundedLevenbergMarquardt` when not given,
            and always with `through`.
        max_steps: steps allowed, at least 1.
        throw: raise an error, rather than report it in `Solution.result`, when the solver fails.

    Raises:
        ArgumentError: (a `ValueError`) an argument out of range or of the wrong kind, a limit to what is not
            free, or no point with positive weight.
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
    asked = prepared(
        points, camera, lens, free=free, solver=solver, max_steps=max_steps,
        keep_field_of_view=keep_field_of_view, priors=priors, close_focus=close_focus,
        min_focus_distance=min_focus_distance,
        max_focus_distance=max_focus_distance, f_number_range=f_number_range, tilt_range=tilt_range,
        swing_range=swing_range, focal_length_range=focal_length_range, shift_range=shift_range,
        rise_range=rise_range,
    )  # fmt: skip
    if through is not None:
        refuse_glass(close_focus)
        asked = dataclasses.replace(asked, glass=checked_glass(through, asked))
    solution, failed = solve_asked(asked)
    # A known success skips the machinery of errors inside compiled code.
    if throw and (isinstance(failed, Tracer) or bool(failed)):
        if isinstance(failed, Tracer):
            return solution.result.error_if(solution, failed)
        raise RuntimeError(f"the solve failed after {int(solution.steps)} steps: {Result[solution.result]}")
    return solution


def solve_asked(asked: Asked) -> tuple[Solution, Bool[Array, ""]]:
    """The solution of one checked problem, and whether the solver failed."""
    points = asked.points
    count = points.disparity.shape[0]
    padded_ = anonymous(padded(points, room_for(count)))
    solving = _solve if asked.glass is None else solve_through
    solution, failed = solving(dataclasses.replace(asked, points=padded_))
    if reframes(asked.plan.free, asked.plan.close_focus):
        points = named_like(first_rows(solution.points, count), points)
    solution = dataclasses.replace(
        solution,
        points=points,
        blur=first_rows(solution.blur, count),
        error=first_rows(solution.error, count),
        asked=asked,
    )
    return solution, failed


def prepared(
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    *,
    usage: str = "solve(points, camera, lens)",
    axes: int = 1,
    free: str | Sequence[str] = ("focus",),
    solver: Any = None,
    max_steps: int = 256,
    keep_field_of_view: bool = False,
    priors: Mapping[str, Prior] | None = None,
    close_focus: CloseFocus = "ignored",
    **ranges: Any,
) -> Asked:
    """The arguments of a solve, checked; `usage` and `axes` are for `require_points`."""
    require_points(points, usage, axes=axes)
    require_lens(camera, lens, usage)
    free = in_order(free)
    _refuse_other_solvers(solver)
    require_switches(keep_field_of_view=keep_field_of_view)
    with about("max_steps"):
        require_counts(max_steps=max_steps)
    if "focal_length" in free and ranges.get("focal_length_range") is None:
        raise ArgumentError(
            "the focal length is free without a range; give focal_length_range in metres",
            "focal_length_range",
        )
    require_close_focus(close_focus)
    limits = make_limits(camera, close_focus=close_focus, **ranges)
    refuse_idle(ranges, free)
    if keep_field_of_view and "focal_length" not in free:
        raise ArgumentError(
            "keep_field_of_view is given, but focal_length is not free, so that it would change nothing; add"
            " 'focal_length' to free, or leave keep_field_of_view out",
            "keep_field_of_view",
        )
    numbers = checked_priors(priors or {}, free)
    points = checked_points(points)
    check_start(camera, lens, limits, free, close_focus)
    if close_focus != "ignored":
        points = checked_close_focus(points, camera, lens, free, tuple(priors or {}), close_focus)
    plain = points.relation is None and points.quantity is None and not priors
    exact = plain and free in (("focus",), ("focus", "f_number"))
    plan = Plan(
        free=free,
        keep_view=keep_field_of_view,
        exact=exact,
        # Without a search it makes no difference, so that it compiles nothing of its own.
        many=not exact and (isinstance(points.signed, Tracer) or not np.asarray(points.signed).all()),
        solver=solver,
        max_steps=max_steps,
        close_focus=close_focus,
    )
    return Asked(points, camera, lens, limits, numbers, plan)


def _refuse_other_solvers(solver: Any) -> None:
    if solver is None:
        return
    import optimistix as optx

    if not isinstance(solver, optx.AbstractLeastSquaresSolver | optx.AbstractMinimiser):
        raise ArgumentError(
            f"solver is {kind_of(solver)}; expected a solver of Optimistix for least squares or minimisation,"
            " as optimistix.Dogleg(1e-5, 1e-5) or focusjax.solvers.JaxoptLBFGSB()",
            "solver",
        )


@jit_in_haste
def _solve(asked: Asked) -> tuple[Solution, Bool[Array, ""]]:
    """The compiled part."""
    return solved(asked)


def solved(asked: Asked) -> tuple[Solution, Bool[Array, ""]]:
    """Settle sides and active bounds, refine, report; and whether that failed."""
    points, plan = asked.points, asked.plan
    start, priors, box, first = place_of(asked)
    basin = basin_of(asked)
    problem = Problem(make_objective(points, start, priors), basin.side, basin.on)
    value, steps, result = refined(problem, basin, first, box, plan.solver, plan.max_steps)
    # Rounding may carry a free parameter past a bound that it reaches without being pushed.
    value = value + jax.lax.stop_gradient(jnp.clip(value, box.lower, box.upper) - value)
    camera, lens, seen = start.camera_at(value), start.lens_at(value), start.points_at(value, points)
    blur, error = blurs(seen, camera, lens), errors(seen, camera, lens)
    return ended(seen, start, basin, value, blur, error, jnp.sum(priors(value) ** 2), steps, result)


def solve_many(
    points: ImagePoints, camera: Camera, lens: ThinLens | TiltShiftLens, *, throw: bool = True, **options: Any
) -> Solution:
    """The lenses that meet many sets of wishes best, each as `solve` finds it.

    Args:
        points: one set of wishes per entry of the leading axis that every array has (see `stacked`).
        camera: the pinhole that frames all pictures.
        lens: where to start.
        throw: raise an error when the solver fails for some set.
        options: as for `solve`, the same for all sets.

    Returns:
        A solution whose arrays have the leading axis of `points`.

    Raises:
        ValueError: as `solve`.
        RuntimeError: the solver failed for some set, and `throw` is true.

    Example:
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate, stacked
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> sets = [locate([FocusPoint(AtPoint((0, 0, -z)), Sharp())], camera) for z in (1.0, 2.0, 4.0)]
        >>> solve_many(stacked(sets), camera, start).lens.focus_disparity.round(6).tolist()
        [1.0, 0.5, 0.25]
    """
    usage = "solve_many(points, camera, lens)"
    require_points(points, usage, axes=2)
    asked = prepared(anonymous(points), camera, lens, usage=usage, axes=2, **options)
    solutions, failed = _solve_all(asked)
    if throw and bool(jnp.any(failed)):
        count = int(failed.sum())
        raise RuntimeError(
            f"the solver failed for {count} of {failed.size} problems, of which {int(failed.argmax())} is the"
            " first; `throw=False` and `Solution.result` say why"
        )
    assert solutions.asked is not None
    seen, wished = (named_like(each, points) for each in (solutions.points, solutions.asked.points))
    return dataclasses.replace(
        solutions, points=seen, asked=dataclasses.replace(solutions.asked, points=wished)
    )


@jit
def _solve_all(asked: Asked) -> tuple[Solution, Bool[Array, "p"]]:
    def one(points: ImagePoints) -> tuple[Solution, Bool[Array, ""]]:
        problem = dataclasses.replace(asked, points=points)
        solution, failed = solved(problem)
        return dataclasses.replace(solution, asked=problem), failed

    return jax.vmap(one)(asked.points)
