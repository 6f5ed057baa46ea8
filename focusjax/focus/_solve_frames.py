"""The lenses of a whole shot, solved for all frames at once."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from focusjax._programs import jit_in_haste
from focusjax.focus._frames_asked import FramesAsked, frames_asked, padded_frames
from focusjax.focus._frames_problem import at_bounds, frames_problem, openness, thin_walk
from focusjax.focus._frames_solution import FramesSolution, without_padding
from focusjax.focus._image_points import ImagePoints, blurs, errors
from focusjax.focus._joint import following
from focusjax.focus._parameters import Start
from focusjax.focus._solution import PARTLY_OPEN, Result, has_failed, result_of
from focusjax.focus._solve import Glass
from focusjax.focus._solve_frames_glass import solve_frames_through
from focusjax.geometry import Camera
from focusjax.lens import ThinLens, TiltShiftLens

_HELD = 1.0 - 1e-6
"""The share from which on it stays, whatever the others do."""


def solve_frames(
    points: Sequence[ImagePoints],
    cameras: Camera | Sequence[Camera],
    lenses: ThinLens | TiltShiftLens | Sequence[ThinLens | TiltShiftLens],
    *,
    through: Glass | Sequence[Glass] | None = None,
    smoothness: ArrayLike = 100.0,
    steadiness: ArrayLike = 1.0,
    max_steps: int = 256,
    held: Mapping[str, Sequence[bool]] | None = None,
    throw: bool = True,
    **options: Any,
) -> FramesSolution:
    """The lenses that meet the wishes of all frames of a shot best, and change smoothly over it.

    Minimises, over the free parameters x_t of all frames t together,

        sum_t  sum weight x (error in pixels)^2 + squared priors
             + smoothness |x_t - 2 x_(t-1) + x_(t-2)|^2 + steadiness |x_t - x_(t-1)|^2

    within the bounds, by steps of Gauss and Newton, and of Newton where they help more, on the banded system
    that couples each frame to the two before it. For the last line the parameters are measured in pixels, by
    how much they change the picture: focus in the change of blur it makes through the starting lens, the
    aperture in that of a blur of 10 px, tilt and swing in that of blur at the picture's edge, the focal
    length in the shift of the edge, shift and rise in that of the picture. So a smoothness of 1 makes a
    change of blur that quickens by 1 px per frame^2 cost as much as a wish of weight 1 missed by 1 px.
    Against wishes of weight 1, a sudden change is spread over about the fourth root of `smoothness` frames,
    and what no wish holds comes to rest within about sqrt(smoothness / steadiness) frames.

    Frames without wishes that count are filled in by smoothness alone. Wishes whose weight rises
    and falls over some frames come and go without a jump (see `focusjax.shot`). Where a wish leaves its side
    open, all frames together choose, and one frame alone gives what `solve` gives. The choice is searched for
    from paths through the frames' own good answers, and by a beam search over sides; the best may be missed,
    but is rarely, where wishes contradict each other.

    As that of `solve`, the solution is differentiable, by the implicit function theorem, in the points, the
    cameras, the bounds, the priors, the two smoothing weights and whatever of the lenses is not solved for,
    with sides and active bounds held: once, forward or backward.

    With `through` all of this is of the blur of a real lens, as in `solve`, smoothness between frames and
    the report included. Points are exchanged for ones that a thin lens blurs as the glass does and all
    frames are solved again, up to five times, until that changes no picture by 0.02 px; Gauss-Newton steps
    on the blur of the glass follow, until one changes no picture by 1e-4 px. What the wishes leave open, and
    the sides of the focus, stay as the rounds left them. There are no derivatives: traced values are refused.

    A shot is filled up to 4, 6, 8, 12, 16, 24, 32, ... frames that take no part, so that shots of other
    lengths use what is compiled; so do other priors. One frame is by itself.

    Args:
        points: every frame's wishes, the same in every frame, as `locate` finds them; there may be frames in
            which none has weight, but not only such.
        cameras: of every frame, or one for all.
        lenses: where to start, and what is not free, of every frame or one for all.
        through: the real lens that makes the pictures, or one for every frame, of one prescription; each made
            for its frame's camera and as wide as it may open. Only "focus" and "f_number" can be free.
            `FramesSolution.glass_at` gives the lens to use.
        smoothness: weight of second differences, in 1 / (px / frame^2)^2 of a wish of weight 1.
        steadiness: weight of first differences; a little of it keeps the focus from running on after
            the last wish.
        max_steps: steps allowed for given sides of the focus.
        held: by names of free parameters: whether they stay as the frame's lens and camera have them, one a
            frame. Those of other frames change smoothly up to them.
        throw: raise an error, rather than report it in `FramesSolution.result`, when the solver fails.
        options: bounds, priors, `close_focus` and what is free, as for `solve`. They are the same for all
            frames. With a model of close focus the focus is measured in its own setting (`FocusScale`).

    Raises:
        ValueError: an argument out of range, frames that do not fit together, no point with weight, or traced
            values with `through`.
        RuntimeError: the solver failed, and `throw` is true.

    Example:
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> walker = [locate([FocusPoint(AtPoint((0, 0, -z)), Sharp())], camera) for z in (4.0, 3.9, 3.8)]
        >>> solution = solve_frames(walker, camera, start, steadiness=0.0)
        >>> [round(1 / w, 2) for w in solution.settings()["focus_per_m"].tolist()]
        [4.0, 3.9, 3.8]
    """
    asked = frames_asked(
        points, cameras, lenses,
        through=through, smoothness=smoothness, steadiness=steadiness, max_steps=max_steps,
        held=held or {}, options=options,
    )  # fmt: skip
    solution = solve_frames_asked(asked)
    failed = has_failed(solution.result)
    if isinstance(failed, Tracer):
        return solution.result.error_if(solution, failed) if throw else solution
    if throw and bool(failed):
        raise RuntimeError(
            f"the solve of {len(points)} frames failed after {int(solution.steps)} steps:"
            f" {Result[solution.result]}"
        )
    return solution


def solve_frames_asked(asked: FramesAsked) -> FramesSolution:
    """The solution of a checked problem."""
    if asked.glass is not None:
        return solve_frames_through(asked)
    # Names are static: without them, other names do not compile the solver again.
    solution = _solve(padded_frames(dataclasses.replace(asked, names=())))
    solution = without_padding(solution, asked.present.size)
    points = dataclasses.replace(solution.points, names=asked.names)
    return dataclasses.replace(solution, points=points, asked=asked)


@jit_in_haste
def _solve(asked: FramesAsked) -> FramesSolution:
    """The compiled part."""
    plan = asked.plan
    problem = frames_problem(asked)
    joint, start, first, boxes = problem.joint, problem.start, problem.first, problem.boxes
    # The search is not differentiated: what it finds is made to follow the wishes afterwards.
    walked = thin_walk(problem, asked)
    still = jax.lax.stop_gradient(joint)
    here = still.linearised(walked.pixels, walked.side)
    at_lower, at_upper = at_bounds(still, here, walked.pixels)
    open_ = openness(still, here)
    kept = jnp.where(open_ > _HELD, first * joint.scale, 0.0)
    is_open = open_ > PARTLY_OPEN
    kept = kept - jax.lax.stop_gradient(kept)
    pixels = following(joint, walked.pixels, walked.side, at_lower | asked.held, at_upper, kept, is_open)
    # What is held is no bound that keeps it from a better value.
    at_lower, at_upper = at_lower & ~asked.held, at_upper & ~asked.held
    value = pixels / joint.scale
    # Rounding may carry a parameter past its bound.
    value = value + jax.lax.stop_gradient(jnp.clip(value, boxes.lower, boxes.upper) - value)

    def of_frame(start: Start, value: Float[Array, "k"], points: ImagePoints) -> tuple[Any, ...]:
        camera, lens, points = start.camera_at(value), start.lens_at(value), start.points_at(value, points)
        return camera, lens, points, blurs(points, camera, lens), errors(points, camera, lens)

    camera, lens, points, blur, error = jax.vmap(of_frame)(start, value, asked.points)
    error = jnp.where(asked.present[:, None], error, 0.0)
    return FramesSolution(
        lens=lens,
        camera=camera,
        points=points,
        blur=blur,
        error=error,
        pixels=pixels,
        cost=joint.unit * joint.cost(pixels, walked.side),
        roughness=0.5 * joint.unit * sum(jnp.sum(each**2) for each in joint.smooth(pixels)),
        result=result_of(walked.settled, is_open, error),
        steps=walked.steps,
        at_lower=at_lower,
        at_upper=at_upper,
        open=is_open,
        free=plan.free,
        close_focus=plan.close_focus,
    )
