"""The lenses of a whole shot, solved for all frames at once."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box, Limits
from focusjax.focus._frames_solution import FramesSolution
from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._image_points import ImagePoints, blurs, errors, padded, stacked
from focusjax.focus._joint import Joint, scales, walk_frames
from focusjax.focus._objective import Objective, make_objective
from focusjax.focus._parameters import Start, make_start
from focusjax.focus._path import way_through
from focusjax.focus._priors import Numbers, prior_rows
from focusjax.focus._solution import Plan, Result
from focusjax.focus._solve import prepared, room_for
from focusjax.geometry import Camera
from focusjax.lens import ThinLens, TiltShiftLens, as_tilt_shift


def solve_frames(
    points: Sequence[ImagePoints],
    cameras: Camera | Sequence[Camera],
    lenses: ThinLens | TiltShiftLens | Sequence[ThinLens | TiltShiftLens],
    *,
    smoothness: float = 100.0,
    steadiness: float = 1.0,
    max_steps: int = 256,
    throw: bool = True,
    **options: Any,
) -> FramesSolution:
    """The lenses that meet the wishes of all frames of a shot best, and change smoothly over it.

    Minimises, over the free parameters x_t of all frames t together,

        sum_t  sum weight x (error in pixels)^2 + squared priors
             + smoothness |x_t - 2 x_(t-1) + x_(t-2)|^2 + steadiness |x_t - x_(t-1)|^2

    within the bounds, by Gauss-Newton steps on the banded system that couples each frame to the two before
    it. For the last line the parameters are measured in pixels (see `_joint`): focus in the change
    of blur it makes through the starting lens, the aperture in that of a blur of 10 px, tilt and swing in
    that of blur at the picture's edge, the focal length in the shift of the edge. So a smoothness of 1 makes
    a change of blur that quickens by 1 px per frame^2 cost as much as a wish of weight 1 missed by 1 px.
    Against wishes of weight 1, a sudden change is spread over about the fourth root of `smoothness` frames,
    and what no wish holds comes to rest within about sqrt(smoothness / steadiness) frames.

    Frames without wishes that count are filled in by smoothness alone. Wishes whose weight rises
    and falls over some frames come and go without a jump (see `focusjax.shot`). Where a wish leaves its side
    open, all frames together choose, and one frame alone gives what `solve` gives. How sides
    are best chosen over all frames is searched from the frames' own good answers only, so that a better
    choice may be missed where wishes contradict each other. Unlike that of `solve`, the solution carries no
    gradients.

    Args:
        points: every frame's wishes, the same in every frame, as `locate` finds them; there may be frames in
            which none has weight, but not only such.
        cameras: of every frame, or one for all.
        lenses: where to start, and what is not free, of every frame or one for all.
        smoothness: weight of second differences, in 1 / (px / frame^2)^2 of a wish of weight 1.
        steadiness: weight of first differences; a little of it keeps the focus from running on after
            the last wish.
        max_steps: steps allowed in all.
        throw: raise an error, rather than report it in `FramesSolution.result`, when the solver fails.
        options: bounds, priors and what is free, as for `solve`. They are the same for all frames.

    Raises:
        ValueError: an argument out of range, frames that do not fit together, or no point with weight.
        RuntimeError: the solver failed, and `throw` is true.

    Example:
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> walker = [locate([FocusPoint(AtPoint((0, 0, -z)), Sharp())], camera) for z in (4.0, 3.9, 3.8)]
        >>> solution = solve_frames(walker, camera, start)
        >>> [round(1 / w, 2) for w in solution.settings()["focus_per_m"].tolist()]
        [4.0, 3.9, 3.8]
    """
    for name, weight in (("smoothness", smoothness), ("steadiness", steadiness)):
        if not 0 <= weight < np.inf:
            raise ValueError(f"{name} is {weight}; expected zero or a positive finite number")
    asked, plan = _asked(points, cameras, lenses, options)
    bend, pace = jnp.asarray(smoothness, dtype=float), jnp.asarray(steadiness, dtype=float)
    solution, slopes = _solve(asked, bend, pace, jnp.asarray(max_steps), plan)
    is_open = _open(np.asarray(slopes, dtype=float))
    named = dataclasses.replace(solution.points, names=points[0].names)
    result = solution.result
    if is_open.any() and bool(result == Result.solved):
        result = Result.undetermined
    solution = dataclasses.replace(solution, points=named, open=jnp.asarray(is_open), result=result)
    if throw and bool((result == Result.max_steps_reached) | (result == Result.not_finite)):
        raise RuntimeError(
            f"the solve of {len(points)} frames failed after {int(solution.steps)} steps:"
            f" {Result[solution.result]}"
        )
    return solution


class _Asked(eqx.Module):
    """A shot, its values checked; every array has a leading axis of frames.

    Attributes:
        points: wishes.
        filled: the same, with those of a frame nearby where none counts.
        counts: frames whose wishes are their own.
        camera: pinholes.
        lens: where to start.
        limits: bounds.
        numbers: priors by name.
    """

    points: ImagePoints
    filled: ImagePoints
    counts: Bool[Array, "t"]
    camera: Camera
    lens: ThinLens | TiltShiftLens
    limits: Limits
    numbers: Numbers


def _asked(
    points: Sequence[ImagePoints],
    cameras: Camera | Sequence[Camera],
    lenses: ThinLens | TiltShiftLens | Sequence[ThinLens | TiltShiftLens],
    options: dict[str, Any],
) -> tuple[_Asked, Plan]:
    """The arguments of a solve, checked and stacked."""
    if not points:
        raise ValueError("there are no frames; give the focus points of at least one")
    for frame, each in enumerate(points):
        if each.names != points[0].names:
            raise ValueError(
                f"frame {frame} has the wishes {list(each.names)}, but frame 0 has {list(points[0].names)};"
                " give all frames the same, with weight 0 where they are not to count"
            )
    count = len(points)
    cameras = [cameras] * count if isinstance(cameras, Camera) else list(cameras)
    lenses = [lenses] * count if isinstance(lenses, ThinLens | TiltShiftLens) else list(lenses)
    for what, given in (("cameras", cameras), ("lenses", lenses)):
        if len(given) != count:
            raise ValueError(
                f"there are {len(given)} {what} for {count} frames; give one each, or one for all"
            )
    if len({(camera.width, camera.height) for camera in cameras}) > 1:
        raise ValueError("the cameras have pictures of several sizes; give all frames the same size")
    if any(isinstance(lens, TiltShiftLens) for lens in lenses):
        lenses = [as_tilt_shift(lens) for lens in lenses]
    weights = np.array([float(np.sum(each.weight)) for each in points])
    own = weights > 0
    if not own.any():
        raise ValueError("no wish counts in any frame; give at least one a weight in one of them")
    nearest = [int(np.flatnonzero(own)[np.argmin(np.abs(np.flatnonzero(own) - t))]) for t in range(count)]
    checked: dict[tuple[int, int], Any] = {}
    plans = []
    for t in range(count):
        key = (id(cameras[t]), id(lenses[t]))
        if key not in checked:
            checked[key] = prepared(points[nearest[t]], cameras[t], lenses[t], **options)
        plans.append(checked[key])
    rows = room_for(max(each.disparity.shape[0] for each in points))
    alike = stacked([padded(each, rows) for each in points])
    alike = dataclasses.replace(alike, names=(), notes=())
    filled = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[nearest]), alike)
    plan = dataclasses.replace(plans[0].plan, exact=False, many=not bool(np.asarray(alike.signed).all()))
    if plan.method != "optimistix":
        raise ValueError(f"method is {plan.method!r}; frames are solved together by one method only")
    stack = lambda *leaves: jnp.asarray(np.stack([np.asarray(leaf) for leaf in leaves]))  # noqa: E731
    return (
        _Asked(
            points=alike,
            filled=filled,
            counts=jnp.asarray(own),
            camera=jax.tree.map(stack, *cameras),
            lens=jax.tree.map(stack, *lenses),
            limits=jax.tree.map(stack, *(each.limits for each in plans)),
            numbers=plans[0].numbers,
        ),
        plan,
    )


@eqx.filter_jit
def _solve(
    asked: _Asked,
    smoothness: Float[Array, ""],
    steadiness: Float[Array, ""],
    max_steps: Int[Array, ""],
    plan: Plan,
) -> tuple[FramesSolution, Float[Array, "t m k"]]:
    """The compiled part; and how residuals change with parameters, in pixels over their ranges."""

    def one(
        points: ImagePoints, camera: Camera, lens: ThinLens | TiltShiftLens, limits: Limits
    ) -> tuple[Objective, Start, Float[Array, "k"], Box, Float[Array, "k"]]:
        start = make_start(camera, lens, plan.free, keep_view=plan.keep_view)
        box = limits.box(camera).columns(start.columns)
        columns = jnp.array(start.columns)
        first = jnp.clip(start.vector()[columns], box.lower, box.upper)
        frame = make_objective(points, start, prior_rows(asked.numbers, plan.free, camera))
        return frame, start, first, box, scales(start)[columns]

    each_frame = asked.camera, asked.lens, asked.limits
    frames, start, first, boxes, scale = jax.vmap(one)(asked.points, *each_frame)
    scale = jnp.where(jnp.array([name == "focus" for name in plan.free]), jnp.mean(scale, axis=0), scale)
    joint = Joint(
        frames=frames,
        scale=scale,
        lower=boxes.lower * scale,
        upper=boxes.upper * scale,
        smoothness=smoothness,
        steadiness=steadiness,
        unit=jnp.max(jnp.sum(asked.points.weight, axis=1)),
    )
    filled = dataclasses.replace(joint, frames=jax.vmap(one)(asked.filled, *each_frame)[0])
    way = way_through(filled, first, boxes, asked.counts, many=plan.many, max_steps=max_steps)
    way = jnp.clip(way, joint.lower, joint.upper)
    walked = walk_frames(joint, way, max_steps)
    value = jnp.clip(walked.pixels / scale, boxes.lower, boxes.upper)

    def of_frame(start: Start, value: Float[Array, "k"], points: ImagePoints) -> tuple[Any, ...]:
        camera, lens, points = start.camera_at(value), start.lens_at(value), start.points_at(value, points)
        return camera, lens, points, blurs(points, camera, lens), errors(points, camera, lens)

    camera, lens, points, blur, error = jax.vmap(of_frame)(start, value, asked.points)
    here = joint.linearised(walked.pixels, walked.side)
    rounding = 1e3 * jnp.finfo(value.dtype).eps * (1.0 + jnp.abs(walked.pixels))
    width = jnp.mean(joint.upper - joint.lower, axis=0)
    result = Result.where(walked.settled, Result.solved, Result.max_steps_reached)
    finite = jnp.all(jnp.isfinite(error)) & jnp.all(jnp.isfinite(value))
    result = Result.where(finite, result, Result.not_finite)
    solution = FramesSolution(
        lens=lens,
        camera=camera,
        points=points,
        blur=blur,
        error=error,
        pixels=walked.pixels,
        cost=joint.unit * here.cost,
        roughness=0.5 * joint.unit * (jnp.sum(here.bent**2) + jnp.sum(here.paced**2)),
        result=result,
        steps=walked.steps,
        at_lower=(walked.pixels <= joint.lower) & (here.gradient > rounding),
        at_upper=(walked.pixels >= joint.upper) & (here.gradient < -rounding),
        open=jnp.zeros(len(plan.free), dtype=bool),
        free=plan.free,
    )
    return solution, here.slopes * width[None, None]


def _open(slopes: Float[np.ndarray, "t m k"]) -> Bool[np.ndarray, "k"]:
    """Parameters that could go through their whole range in all frames at once and change no blur by much."""
    _, strength, rows = np.linalg.svd(slopes.reshape(-1, slopes.shape[2]), full_matrices=False)
    return np.sum(rows[strength < UNDETERMINED_PX] ** 2, axis=0) > _PARTLY_OPEN


_PARTLY_OPEN = 0.01
"""As for one picture: the share of an open direction from which on a parameter is called open."""
