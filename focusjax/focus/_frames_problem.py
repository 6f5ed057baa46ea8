"""The problem of all frames as compiled code has it, and where an ideal lens solves it."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax.focus._bounds import Box, Limits
from focusjax.focus._frames_asked import FramesAsked
from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._image_points import ImagePoints
from focusjax.focus._joint import Joint, JointWalk, Linearised, walk_frames
from focusjax.focus._objective import Objective, make_objective
from focusjax.focus._parameters import Start, make_start, scales
from focusjax.focus._path import way_through
from focusjax.focus._priors import prior_rows
from focusjax.focus._solution import Result
from focusjax.geometry import Camera
from focusjax.lens import ThinLens, TiltShiftLens


class FramesProblem(eqx.Module):
    """A shot to solve. Arrays have a leading axis t of frames.

    Attributes:
        joint: all frames together.
        filled: the same with wishes in every frame, those of the nearest where a frame has none.
        start: every frame's start.
        first: the free parameters there.
        boxes: their bounds; what is held has no room.
    """

    joint: Joint
    filled: Joint
    start: Start
    first: Float[Array, "t k"]
    boxes: Box


def frames_problem(asked: FramesAsked) -> FramesProblem:
    """The problem of checked arguments."""
    plan = asked.plan

    def one(
        points: ImagePoints,
        camera: Camera,
        lens: ThinLens | TiltShiftLens,
        limits: Limits,
        held: Bool[Array, "k"],
    ) -> tuple[Objective, Start, Float[Array, "k"], Box, Float[Array, "k"]]:
        start = make_start(camera, lens, plan.free, keep_view=plan.keep_view, close_focus=plan.close_focus)
        box = limits.box(camera, plan.close_focus).columns(start.columns)
        columns = jnp.array(start.columns)
        given = start.vector()[columns]
        box = Box(jnp.where(held, given, box.lower), jnp.where(held, given, box.upper))
        first = jnp.clip(given, box.lower, box.upper)
        frame = make_objective(points, start, prior_rows(asked.numbers, plan.free, camera))
        return frame, start, first, box, scales(start)[columns]

    each_frame = asked.camera, asked.lens, asked.limits, asked.held
    frames, start, first, boxes, scale = jax.vmap(one)(asked.points, *each_frame)
    scale = jnp.where(jnp.array([name == "focus" for name in plan.free]), jnp.mean(scale, axis=0), scale)
    joint = Joint(
        frames=frames,
        scale=scale,
        lower=boxes.lower * scale,
        upper=boxes.upper * scale,
        smoothness=asked.smoothness,
        steadiness=asked.steadiness,
        unit=jnp.max(jnp.sum(asked.points.weight, axis=1)),
    )
    filled = dataclasses.replace(joint, frames=jax.vmap(one)(asked.filled(), *each_frame)[0])
    return FramesProblem(joint, filled, start, first, boxes)


def thin_walk(problem: FramesProblem, asked: FramesAsked) -> JointWalk:
    """The best parameters for an ideal lens, without derivatives."""
    problem = jax.lax.stop_gradient(problem)
    way = way_through(
        problem.filled,
        problem.first,
        problem.boxes,
        asked.own,
        many=asked.plan.many,
        max_steps=asked.plan.max_steps,
    )
    joint = problem.joint
    return walk_frames(joint, jnp.clip(way, joint.lower, joint.upper), asked.plan.max_steps)


def at_bounds(
    joint: Joint, here: Linearised, pixels: Float[Array, "t k"]
) -> tuple[Bool[Array, "t k"], Bool[Array, "t k"]]:
    """What a lower and what an upper bound keeps from a better value."""
    rounding = 1e3 * jnp.finfo(pixels.dtype).eps * (1.0 + jnp.abs(pixels))
    at_lower = (pixels <= joint.lower) & (here.gradient > rounding)
    return at_lower, (pixels >= joint.upper) & (here.gradient < -rounding)


def openness(joint: Joint, here: Linearised) -> Float[Array, "k"]:
    """How open each parameter is, from 0 to 1.

    Open are directions that could go through their whole range in all frames at once, and change no blur by
    much.
    """
    slopes = here.jacobian.slopes * jnp.mean(joint.upper - joint.lower, axis=0)[None, None]
    rows = slopes.reshape(-1, slopes.shape[2])
    short = max(0, rows.shape[1] - rows.shape[0])
    small = jnp.linalg.qr(jnp.pad(rows, ((0, short), (0, 0))), mode="r")
    _, strength, directions = jnp.linalg.svd(small)
    return jnp.sum(jnp.where(strength[:, None] < UNDETERMINED_PX, directions**2, 0.0), axis=0)


def result_of(settled: Bool[Array, ""], is_open: Bool[Array, "k"], error: Float[Array, "t n"]) -> Result:
    """How a solve of all frames ended."""
    result = Result.where(settled, Result.solved, Result.max_steps_reached)
    result = Result.where((result == Result.solved) & jnp.any(is_open), Result.undetermined, result)
    return Result.where(jnp.all(jnp.isfinite(error)), result, Result.not_finite)
