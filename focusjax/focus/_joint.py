"""All frames of a shot as one least-squares problem: the wishes of each, and smoothness from one to the next.

The unknowns are the free parameters of every frame (see `_parameters`), each times a scale that makes a
unit of it about a pixel on the picture:

    focus          2 f E, the change of every blur;
    f-number       `REFERENCE_BLUR` / E, the change of a blur of that size;
    tilt, swing    E times the picture's height or width, the change of blur at its edge;
    focal length   half the picture's width, the shift of its edge.

f and E are those of the starting lens, over the shot for the focus and of each frame for the others: a camera
that zooms keeps its f-number while these stay.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._banded import banded_least_squares
from focusjax.focus._bounds import Box
from focusjax.focus._image_points import root_weight
from focusjax.focus._objective import Objective
from focusjax.focus._parameters import RADIUS, Start

REFERENCE_BLUR = 10.0
"""Diameter in pixels of the blur whose change stands for that of the aperture."""

_GENTLE = 1e-3
_HOPELESS = 1e8
"""Damping after a step that did not help, and that at which no step is left; see `_walk`."""


class Joint(eqx.Module):
    """The problem for given sides.

    Attributes:
        frames: every frame's own objective, with a leading axis.
        scale: pixels per unit of every frame's free parameters.
        box: bounds on the parameters in pixels.
        smoothness: weight of a squared second difference of 1 px per frame^2.
        steadiness: weight of a squared first difference of 1 px per frame.
        unit: weight that counts as 1, so that the numbers stay near it.
    """

    frames: Objective
    scale: Float[Array, "t k"]
    box: Box
    smoothness: Float[Array, ""]
    steadiness: Float[Array, ""]
    unit: Float[Array, ""]

    @property
    def bend(self) -> Float[Array, "t k"]:
        """Factor of every frame's second difference."""
        return self._from_frame(2, self.smoothness)

    @property
    def pace(self) -> Float[Array, "t k"]:
        """Factor of every frame's first difference."""
        return self._from_frame(1, self.steadiness)

    def _from_frame(self, first: int, weight: Float[Array, ""]) -> Float[Array, "t k"]:
        count = self.scale.shape[0]
        factor = jnp.sqrt(weight / self.unit) * (jnp.arange(count) >= first)
        return factor.astype(self.scale.dtype)[:, None] * jnp.ones_like(self.scale)

    def own(
        self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]
    ) -> Float[Array, "t m"]:
        """The frames' own residuals: those of the wishes, then those of the expectations."""

        def one(
            frame: Objective, scale: Float[Array, "k"], pixels: Float[Array, "k"], side: Float[Array, "n"]
        ) -> Float[Array, "m"]:
            value = pixels / scale
            rows = root_weight(frame.points.weight) * frame.errors(value, side)
            return jnp.concatenate([rows, frame.priors(value)])

        return jax.vmap(one)(self.frames, self.scale, pixels, side) / jnp.sqrt(self.unit)

    def smooth(self, pixels: Float[Array, "t k"]) -> tuple[Float[Array, "t k"], Float[Array, "t k"]]:
        """The residuals of second and of first differences, 0 where a frame has too few before it."""
        before, long_before = jnp.roll(pixels, 1, axis=0), jnp.roll(pixels, 2, axis=0)
        return self.bend * (pixels - 2.0 * before + long_before), self.pace * (pixels - before)

    def cost(self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]) -> Float[Array, ""]:
        """Half the sum of all squares, in units of `unit`."""
        bent, paced = self.smooth(pixels)
        return 0.5 * (jnp.sum(self.own(pixels, side) ** 2) + jnp.sum(bent**2) + jnp.sum(paced**2))

    def slopes(self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]) -> Float[Array, "t m k"]:
        """Derivative of every frame's own residuals with respect to its own parameters."""
        size = pixels.shape[1]

        def along(direction: Float[Array, "k"]) -> Float[Array, "t m"]:
            # One frame's residuals know only its own parameters, so one product serves all frames.
            step = jnp.zeros_like(pixels) + direction[None]
            return jax.jvp(lambda at: self.own(at, side), (pixels,), (step,))[1]

        return jax.vmap(along, out_axes=-1)(jnp.eye(size, dtype=pixels.dtype))

    def gradient(self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]) -> Float[Array, "t k"]:
        """Derivative of the cost."""
        return jax.grad(self.cost)(pixels, side)

    def natural_side(self, pixels: Float[Array, "t k"]) -> Float[Array, "t n"]:
        """The sides on which all points are."""
        return jax.vmap(Objective.natural_side)(self.frames, pixels / self.scale)


class JointWalk(eqx.Module):
    """Where the search over all frames is; as `_walk.Walk`."""

    pixels: Float[Array, "t k"]
    cost: Float[Array, ""]
    damping: Float[Array, ""]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]


def scales(start: Start) -> Float[Array, "5"]:
    """Pixels per unit of every parameter, of one frame."""
    camera, radius = start.camera, start.vector()[RADIUS]
    safe = jnp.where(radius > 0, radius, 1.0)
    length = camera.focal_length
    return jnp.stack(
        [
            2.0 * camera.focal_px * safe,
            REFERENCE_BLUR / safe,
            safe * camera.height,
            safe * camera.width,
            0.5 * camera.width * jnp.ones_like(length),
        ]
    )


def walk_frames(
    joint: Joint, first: Float[Array, "t k"], max_steps: int
) -> tuple[JointWalk, Float[Array, "t n"]]:
    """The best parameters in the box, downhill from `first`, and the sides there.

    Errors are convex for given sides, so a walk ends at the best there is for them. Then points that have
    crossed the focus change sides, which makes no error larger, and it goes on until none does.
    """

    def more(state: tuple[JointWalk, Float[Array, "t n"], Bool[Array, ""]]) -> Bool[Array, ""]:
        return state[2] & (state[0].steps < max_steps)

    def again(
        state: tuple[JointWalk, Float[Array, "t n"], Bool[Array, ""]],
    ) -> tuple[JointWalk, Float[Array, "t n"], Bool[Array, ""]]:
        walked = _walk(joint, state[1], state[0], max_steps)
        side = joint.natural_side(walked.pixels)
        return walked, side, jnp.any(side != state[1])

    start = JointWalk(
        pixels=first,
        cost=jnp.zeros((), first.dtype),
        damping=jnp.zeros((), first.dtype),
        settled=jnp.array(False),
        steps=jnp.array(0),
    )
    walked, side, changed = jax.lax.while_loop(more, again, (start, joint.natural_side(first), jnp.array(True)))
    return eqx.tree_at(lambda each: each.settled, walked, walked.settled & ~changed), side


def _walk(joint: Joint, side: Float[Array, "t n"], start: JointWalk, max_steps: int) -> JointWalk:
    """Gauss-Newton steps with as little damping as will do, for given sides.

    What is at a bound that the gradient pushes against stays there during a step; the rest takes the step
    and is cut off at its bounds (Bertsekas 1982).
    """
    eps = jnp.finfo(start.pixels.dtype).eps
    least = (1e3 * eps) ** 2

    def more(state: JointWalk) -> Bool[Array, ""]:
        return ~state.settled & (state.steps < max_steps)

    def step(state: JointWalk) -> JointWalk:
        pixels = state.pixels
        gradient = joint.gradient(pixels, side)
        stuck = ((pixels <= joint.box.lower) & (gradient > 0)) | ((pixels >= joint.box.upper) & (gradient < 0))
        bent, paced = joint.smooth(pixels)
        change = banded_least_squares(
            joint.slopes(pixels, side), joint.own(pixels, side), joint.bend, bent, joint.pace, paced,
            state.damping, jnp.where(stuck, 0.0, 1.0).astype(pixels.dtype),
        )  # fmt: skip
        moved = jnp.clip(pixels + change, joint.box.lower, joint.box.upper)
        cost = joint.cost(moved, side)
        better = cost < state.cost
        tiny = jnp.max(jnp.abs(moved - pixels)) <= 16.0 * eps * (1.0 + jnp.max(jnp.abs(pixels)))
        calmer = jnp.maximum(state.damping * 16.0, _GENTLE)
        damping = jnp.where(better, jnp.maximum(state.damping / 32.0, least), calmer)
        return JointWalk(
            pixels=jnp.where(better, moved, pixels),
            cost=jnp.where(better, cost, state.cost),
            damping=damping,
            settled=tiny | (damping > _HOPELESS),
            steps=state.steps + 1,
        )

    begun = JointWalk(
        pixels=start.pixels,
        cost=joint.cost(start.pixels, side),
        damping=jnp.full_like(start.cost, least),
        settled=jnp.array(False),
        steps=start.steps,
    )
    return jax.lax.while_loop(more, step, begun)
