"""All frames of a shot as one least-squares problem: the wishes of each, and smoothness from one to the next.

The unknowns are the free parameters of every frame (see `_parameters`), each times a scale that makes a
unit of it about a pixel on the picture (`scales`). The scale of the focus is the mean over the shot, the
others are each frame's own: a camera that zooms keeps its f-number while these stay.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._banded import banded_least_squares
from focusjax.focus._image_points import root_weight
from focusjax.focus._objective import Objective

_GENTLE = 1e-3
_HOPELESS = 1e8
"""Damping after a step that did not help, and that at which no step is left."""


class Joint(eqx.Module):
    """The problem for given sides.

    Attributes:
        frames: every frame's own objective, with a leading axis.
        scale: pixels per unit of every frame's free parameters.
        lower: bounds on the parameters in pixels.
        upper: the same.
        smoothness: weight of a squared second difference of 1 px per frame^2.
        steadiness: weight of a squared first difference of 1 px per frame.
        unit: weight that counts as 1, so that the numbers stay near it.
    """

    frames: Objective
    scale: Float[Array, "t k"]
    lower: Float[Array, "t k"]
    upper: Float[Array, "t k"]
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

    def own(self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]) -> Float[Array, "t m"]:
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
        return _half_squares(self.own(pixels, side), *self.smooth(pixels))

    def linearised(self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]) -> "Linearised":
        """All residuals and their slopes."""
        size = pixels.shape[1]

        def along(direction: Float[Array, "k"]) -> tuple[Float[Array, "t m"], Float[Array, "t m"]]:
            # One frame's residuals know only its own parameters, so one product serves all frames.
            step = jnp.zeros_like(pixels) + direction[None]
            return jax.jvp(lambda at: self.own(at, side), (pixels,), (step,))

        axes = jnp.eye(size, dtype=pixels.dtype)
        return self.coupled(pixels, *jax.vmap(along, out_axes=(None, -1))(axes))

    def coupled(
        self, pixels: Float[Array, "t k"], own: Float[Array, "t m"], slopes: Float[Array, "t m k"]
    ) -> "Linearised":
        """The frames' own residuals and slopes with those of smoothness."""
        bent, paced = self.smooth(pixels)
        # The differences' transposes; their factors are 0 in frames that have too few before them.
        curve, speed = self.bend * bent, self.pace * paced
        pull = curve - 2.0 * jnp.roll(curve, -1, axis=0) + jnp.roll(curve, -2, axis=0)
        pull = pull + speed - jnp.roll(speed, -1, axis=0)
        gradient = jnp.einsum("tmk,tm->tk", slopes, own) + pull
        return Linearised(own, slopes, bent, paced, gradient, _half_squares(own, bent, paced))

    def step(
        self,
        here: "Linearised",
        pixels: Float[Array, "t k"],
        damping: Float[Array, ""],
        kept: Bool[Array, "k"] | None = None,
    ) -> Float[Array, "t k"]:
        """The parameters after a damped Gauss-Newton step from `pixels`, but those that are `kept`.

        What is at a bound that the gradient pushes against stays there; the rest takes the step and is cut
        off at its bounds (Bertsekas 1982).
        """
        stuck = ((pixels <= self.lower) & (here.gradient > 0)) | (
            (pixels >= self.upper) & (here.gradient < 0)
        )
        if kept is not None:
            stuck |= kept[None]
        change = banded_least_squares(
            here.slopes, here.own, self.bend, here.bent, self.pace, here.paced,
            damping, jnp.where(stuck, 0.0, 1.0).astype(pixels.dtype),
        )  # fmt: skip
        return jnp.clip(pixels + change, self.lower, self.upper)

    def natural_side(self, pixels: Float[Array, "t k"]) -> Float[Array, "t n"]:
        """The sides on which all points are."""
        return jax.vmap(Objective.natural_side)(self.frames, pixels / self.scale)


class Linearised(eqx.Module):
    """A problem near some parameters.

    Attributes:
        own: the frames' own residuals.
        slopes: their derivative with respect to the frame's own parameters.
        bent: residuals of second differences.
        paced: residuals of first differences.
        gradient: of the cost.
        cost: half the sum of all squares.
    """

    own: Float[Array, "t m"]
    slopes: Float[Array, "t m k"]
    bent: Float[Array, "t k"]
    paced: Float[Array, "t k"]
    gradient: Float[Array, "t k"]
    cost: Float[Array, ""]


class JointWalk(eqx.Module):
    """Where the search over all frames is.

    Attributes:
        pixels: the parameters.
        side: for every point, the factor (1 or -1) of its blur in its error.
        damping: of the next step.
        settled: whether the last step was within rounding, and no point has changed sides since.
        steps: steps taken.
    """

    pixels: Float[Array, "t k"]
    side: Float[Array, "t n"]
    damping: Float[Array, ""]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]


def walk_frames(joint: Joint, first: Float[Array, "t k"], max_steps: Int[Array, ""]) -> JointWalk:
    """The best parameters in the box, downhill from `first`.

    Gauss-Newton steps with as little damping as will do (`Joint.step`). Errors are convex for given sides,
    so this comes to rest at the best there is for them. Then points that have crossed the focus change
    sides, which makes no error larger, and it goes on until none does.
    """
    eps = jnp.finfo(first.dtype).eps
    least = jnp.asarray((1e3 * eps) ** 2, first.dtype)

    def more(state: JointWalk) -> Bool[Array, ""]:
        return ~state.settled & (state.steps < max_steps)

    def step(state: JointWalk) -> JointWalk:
        pixels, side = state.pixels, state.side
        here = joint.linearised(pixels, side)
        moved = joint.step(here, pixels, state.damping)
        better = joint.cost(moved, side) < here.cost
        tiny = jnp.max(jnp.abs(moved - pixels)) <= 16.0 * eps * (1.0 + jnp.max(jnp.abs(pixels)))
        calmer = jnp.maximum(state.damping * 16.0, _GENTLE)
        damping = jnp.where(better, jnp.maximum(state.damping / 32.0, least), calmer)
        arrived = tiny | (damping > _HOPELESS)
        pixels = jnp.where(better, moved, pixels)
        natural = jnp.where(arrived, joint.natural_side(pixels), side)
        return JointWalk(
            pixels=pixels,
            side=natural,
            damping=jnp.where(arrived, least, damping),
            settled=arrived & jnp.all(natural == side),
            steps=state.steps + 1,
        )

    start = JointWalk(first, joint.natural_side(first), least, jnp.array(False), jnp.array(0))
    return jax.lax.while_loop(more, step, start)


def _half_squares(*rows: Float[Array, "..."]) -> Float[Array, ""]:
    return 0.5 * sum((jnp.sum(each**2) for each in rows), start=jnp.zeros((), rows[0].dtype))
