"""The problem of all frames as compiled code has it, and where an ideal lens solves it."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax.focus._bounds import Box, Limits
from focusjax.focus._frames_asked import FramesAsked
from focusjax.focus._frames_sides import likely_sides
from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._image_points import ImagePoints
from focusjax.focus._joint import Joint, JointWalk, Linearised, mean_of, walk_frames
from focusjax.focus._objective import Objective, make_objective
from focusjax.focus._parameters import Start, make_start
from focusjax.focus._path import answers_of_each, filled, paths_through
from focusjax.focus._priors import prior_rows
from focusjax.geometry import Camera
from focusjax.lens import ThinLens, TiltShiftLens

_ALIKE = 1e-4
"""Share of the cost by which walks that end alike may differ."""


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
        present: Bool[Array, ""],
    ) -> tuple[Objective, Start, Float[Array, "k"], Box]:
        start = make_start(camera, lens, plan.free, keep_view=plan.keep_view, close_focus=plan.close_focus)
        box = limits.box(camera, plan.close_focus).columns(start.columns)
        given = start.first()
        box = Box(jnp.where(held, given, box.lower), jnp.where(held, given, box.upper))
        first = jnp.clip(given, box.lower, box.upper)
        priors = prior_rows(asked.numbers, plan.free, camera)
        priors = dataclasses.replace(priors, inverse=jnp.where(present, priors.inverse, 0.0))
        frame = make_objective(points, start, priors)
        return frame, start, first, box

    each_frame = asked.camera, asked.lens, asked.limits, asked.held, asked.present
    frames, start, first, boxes = jax.vmap(one)(asked.points, *each_frame)
    is_focus = jnp.array([name == "focus" for name in plan.free])
    scale = jnp.where(is_focus, mean_of(frames.scale, asked.present), frames.scale)
    joint = Joint(
        frames=frames,
        scale=scale,
        lower=boxes.lower * scale,
        upper=boxes.upper * scale,
        smoothness=asked.smoothness,
        steadiness=asked.steadiness,
        unit=jnp.max(jnp.sum(asked.points.weight, axis=1)),
        present=asked.present,
    )
    filled = dataclasses.replace(joint, frames=jax.vmap(one)(asked.filled(), *each_frame)[0])
    return FramesProblem(joint, filled, start, first, boxes)


class _Tried(eqx.Module):
    """The best walk so far, and its cost."""

    walk: JointWalk
    cost: Float[Array, ""]


def thin_walk(problem: FramesProblem, asked: FramesAsked) -> JointWalk:
    """The best parameters for an ideal lens, without derivatives.

    A walk starts from a path through the answers of each frame by itself; where wishes leave their side open,
    others from more such paths, and from the sides that are likely to cost least. The cheapest counts of
    those that come to rest.
    """
    problem = jax.lax.stop_gradient(problem)
    joint, boxes, own = problem.filled, problem.boxes, asked.own
    steps = asked.plan.max_steps
    answers = answers_of_each(joint, problem.first, boxes, many=asked.plan.many, max_steps=steps)
    paths = paths_through(joint, answers, problem.first, boxes, own, steps)
    joint = problem.joint

    def walked(first: Float[Array, "t k"], side: Float[Array, "t n"]) -> _Tried:
        walk = walk_frames(joint, jnp.clip(first, joint.lower, joint.upper), side, steps)
        return _Tried(walk, joint.cost(walk.pixels, joint.natural_side(walk.pixels)))

    if not asked.plan.many or own.size == 1:
        return walked(paths[0], joint.natural_side(paths[0])).walk
    sides, values = likely_sides(problem.filled, answers.values, answers.sides, own)
    likely = jax.vmap(lambda values: filled(values * joint.scale, own))(values)
    firsts = jnp.concatenate([paths, likely])
    sides = jnp.concatenate([jax.vmap(joint.natural_side)(paths), sides])
    same = jnp.all((sides[:, None] == sides[None]) | ~joint.two_sided[None, None], axis=(2, 3))
    known = jnp.any(same & np.tri(len(sides), k=-1, dtype=bool), axis=1)

    def onward(best: _Tried, start: tuple[Array, Array, Array]) -> tuple[_Tried, None]:
        first, side, known = start
        tried = jax.lax.cond(known, lambda: best, lambda: walked(first, side))
        count = jnp.sum(joint.present) * joint.scale.shape[1]
        noise = count * joint.rounding(tried.walk.pixels) ** 2
        cheaper = tried.cost < (1.0 - _ALIKE) * best.cost - noise
        settled = tried.walk.settled
        better = jnp.where(settled == best.walk.settled, cheaper, settled)
        return jax.tree.map(lambda new, old: jnp.where(better, new, old), tried, best), None

    none = JointWalk(paths[0], sides[0], jnp.array(False), jnp.array(0))
    best, _ = jax.lax.scan(onward, _Tried(none, jnp.full_like(joint.unit, jnp.inf)), (firsts, sides, known))
    return best.walk


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
    slopes = here.jacobian.slopes * mean_of(joint.upper - joint.lower, joint.present)[None, None]
    rows = slopes.reshape(-1, slopes.shape[2])
    short = max(0, rows.shape[1] - rows.shape[0])
    small = jnp.linalg.qr(jnp.pad(rows, ((0, short), (0, 0))), mode="r")
    _, strength, directions = jnp.linalg.svd(small)
    return jnp.sum(jnp.where(strength[:, None] < UNDETERMINED_PX, directions**2, 0.0), axis=0)
