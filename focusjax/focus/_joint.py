"""All frames of a shot as one least-squares problem: the wishes of each, and smoothness from one to the next.

The unknowns are the free parameters of every frame (see `_parameters`), each times a scale that makes a
unit of it about a pixel on the picture (`scales`). The scale of the focus is the mean over the shot, the
others are each frame's own: a camera that zooms keeps its f-number while these stay.

Derivatives of the solution are by the implicit function theorem (`following`): there the gradient g(x, theta)
of the cost vanishes along every parameter that no bound pins, so H dx = -dg: with H the cost's second
derivative, and dg the change of g with wishes, bounds and all else. H is eliminated in time linear in the
frames. The sides that wishes have chosen and the active bounds are held.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._image_points import root_weight
from focusjax.focus._objective import Objective

_OPEN_RIDGE = 1e3
"""Rounding steps of H's largest entry that are added for what the wishes leave open, so that it stays."""


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
        present: the frames of the shot; those that fill it up come after them.
    """

    frames: Objective
    scale: Float[Array, "t k"]
    lower: Float[Array, "t k"]
    upper: Float[Array, "t k"]
    smoothness: Float[Array, ""]
    steadiness: Float[Array, ""]
    unit: Float[Array, ""]
    present: Bool[Array, "t"]

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
        factor = jnp.sqrt(weight / self.unit) * (self.present & (jnp.arange(count) >= first))
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
        from focusjax.solvers import half_squares

        return half_squares(self.rows(pixels, side))

    def rows(
        self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]
    ) -> tuple[Float[Array, "t m"], Float[Array, "t k"], Float[Array, "t k"]]:
        """All residuals: the frames' own, and those of second and of first differences."""
        return self.own(pixels, side), *self.smooth(pixels)

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
        from focusjax.solvers import BandedJacobian, half_squares

        rows = own, *self.smooth(pixels)
        jacobian = BandedJacobian(slopes, self.bend, self.pace)
        return Linearised(rows, jacobian, jacobian.T.mv(rows), half_squares(rows))

    def curvature(self, pixels: Float[Array, "t k"], side: Float[Array, "t n"]) -> Float[Array, "t k k"]:
        """Second derivative of every frame's own cost."""

        def own(
            frame: Objective, scale: Float[Array, "k"], pixels: Float[Array, "k"], side: Float[Array, "n"]
        ) -> Float[Array, "k k"]:
            def cost(pixels: Float[Array, "k"]) -> Float[Array, ""]:
                value = pixels / scale
                wishes = frame.points.weight @ frame.errors(value, side) ** 2
                return 0.5 * (wishes + jnp.sum(frame.priors(value) ** 2)) / self.unit

            return jax.hessian(cost)(pixels)

        return jax.vmap(own)(self.frames, self.scale, pixels, side)

    def step(
        self,
        here: "Linearised",
        pixels: Float[Array, "t k"],
        damping: Float[Array, ""],
        kept: Bool[Array, "k"],
    ) -> Float[Array, "t k"]:
        """The parameters after a damped Gauss-Newton step within bounds, but those that are `kept`."""
        from focusjax.solvers import BandedQR, bounded_step

        lower, upper = (jnp.where(kept[None], pixels, bound) for bound in (self.lower, self.upper))
        root = jnp.broadcast_to(jnp.sqrt(damping), pixels.shape)
        change = bounded_step(pixels, here.rows, here.jacobian, lower, upper, root, BandedQR()).change
        return jnp.clip(pixels + change, lower, upper)

    @property
    def two_sided(self) -> Bool[Array, "t n"]:
        """Rows that leave their side open, and for which it makes a difference."""
        return jax.vmap(lambda frame: frame.two_sided)(self.frames)

    def rounding(self, pixels: Float[Array, "t k"]) -> Float[Array, ""]:
        """How far off a parameter in pixels may be."""
        largest = jnp.max(jnp.abs(pixels), where=self.present[:, None], initial=0.0)
        return 16.0 * jnp.finfo(pixels.dtype).eps * (1.0 + largest)

    def natural_side(self, pixels: Float[Array, "t k"]) -> Float[Array, "t n"]:
        """The sides on which all points are."""
        return jax.vmap(Objective.natural_side)(self.frames, pixels / self.scale)


def mean_of(of_frames: Float[Array, "t k"], present: Bool[Array, "t"]) -> Float[Array, "k"]:
    """The mean over the frames of the shot."""
    return jnp.mean(of_frames, axis=0, where=present[:, None])


class Linearised(eqx.Module):
    """A problem near some parameters.

    Attributes:
        rows: all residuals.
        jacobian: their derivative, a `BandedJacobian`.
        gradient: of the cost.
        cost: half the sum of all squares.
    """

    rows: tuple[Float[Array, "t m"], Float[Array, "t k"], Float[Array, "t k"]]
    jacobian: Any
    gradient: Float[Array, "t k"]
    cost: Float[Array, ""]


class JointWalk(eqx.Module):
    """Where the search over all frames is.

    Attributes:
        pixels: the parameters.
        side: for every point, the factor (1 or -1) of its blur in its error.
        settled: whether it is at rest, and no point has changed sides since.
        steps: steps taken.
    """

    pixels: Float[Array, "t k"]
    side: Float[Array, "t n"]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]


def walk_frames(
    joint: Joint, first: Float[Array, "t k"], side: Float[Array, "t n"], max_steps: int
) -> JointWalk:
    """The best parameters in the box, downhill from `first` with all points on given sides.

    Errors are convex for given sides, so a walk comes to rest at the best there is for them. Then points that
    have crossed the focus change sides, which makes no error larger, and it goes on until none does.
    """
    import optimistix as optx

    from focusjax.solvers import BandedQR, BoundedLevenbergMarquardt

    def more(state: JointWalk) -> Bool[Array, ""]:
        return ~state.settled & (state.steps < max_steps)

    def again(state: JointWalk) -> JointWalk:
        found = optx.least_squares(
            _residuals,
            BoundedLevenbergMarquardt(linear_solver=BandedQR()),
            state.pixels,
            args=(joint, state.side),
            options={
                "lower": joint.lower,
                "upper": joint.upper,
                "linearise": _linearised,
                "rounding": _rounding,
                "paths": _paths,
            },
            max_steps=max_steps,
            throw=False,
        )
        natural = joint.natural_side(found.value)
        at_rest = found.result == optx.RESULTS.successful
        steps = state.steps + jnp.asarray(found.stats["num_steps"])
        stay = jnp.all((natural == state.side) | ~decides)
        return JointWalk(found.value, natural, at_rest & stay, steps)

    decides = joint.two_sided
    start = JointWalk(first, side, jnp.array(False), jnp.array(0))
    return jax.lax.while_loop(more, again, start)


def _residuals(pixels: Float[Array, "t k"], args: Any) -> tuple[Array, Array, Array]:
    joint, side = args
    return joint.rows(pixels, side)


def _linearised(fn: Any, pixels: Float[Array, "t k"], args: Any) -> tuple[Any, Any]:
    joint, side = args
    here = joint.linearised(pixels, side)
    return here.rows, here.jacobian


def _paths(
    pixels: Float[Array, "t k"], step: Any, lower: Float[Array, "t k"], upper: Float[Array, "t k"], args: Any
) -> tuple[Float[Array, "t k"], Float[Array, "t k"]]:
    """The step, and Newton's, which arrives in a few where large errors make Gauss and Newton's creep."""
    from focusjax.solvers import solve_hessian

    joint, side = args
    own = joint.curvature(pixels, side)
    newton = solve_hessian(own, joint.bend, joint.pace, step.moves > 0.0, -step.gradient)
    return pixels + step.change, pixels + newton


def _rounding(fn: Any, pixels: Float[Array, "t k"], args: Any) -> tuple[Array, Array, Array]:
    """A residual in pixels moves by as much as a parameter in pixels may be off."""
    joint, _ = args
    rows = jax.eval_shape(lambda: fn(pixels, args)[0])
    size = joint.rounding(pixels)
    return jax.tree.map(lambda row: jnp.broadcast_to(size, row.shape), rows)


@eqx.filter_custom_jvp
def following(
    joint: Joint,
    pixels: Float[Array, "t k"],
    side: Float[Array, "t n"],
    at_lower: Bool[Array, "t k"],
    at_upper: Bool[Array, "t k"],
    kept: Float[Array, "t k"],
    open_: Bool[Array, "k"],
) -> Float[Array, "t k"]:
    """`pixels`, with the derivative of the solution with respect to all that `joint` holds.

    Args:
        joint: the problem, with derivatives.
        pixels: its solution, without.
        side: the sides that points are on there.
        at_lower: parameters that a lower bound keeps from a better value; they follow the bound.
        at_upper: the same for upper bounds.
        kept: values of 0 whose derivatives are those of what the wishes leave open.
        open_: parameters that have a part in what the wishes leave open.
    """
    return pixels


@following.def_jvp
def _following_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    return eqx.filter_jvp(_followed, primals, tangents)


def _followed(
    joint: Joint,
    pixels: Float[Array, "t k"],
    side: Float[Array, "t n"],
    at_lower: Bool[Array, "t k"],
    at_upper: Bool[Array, "t k"],
    kept: Float[Array, "t k"],
    open_: Bool[Array, "k"],
) -> Float[Array, "t k"]:
    """`following`, with a derivative that JAX finds."""
    from focusjax.solvers import solve_hessian

    pinned = at_lower | at_upper
    here = jnp.where(at_lower, joint.lower, jnp.where(at_upper, joint.upper, pixels))
    start = pixels + (here - jax.lax.stop_gradient(here)) + kept
    slope = joint.linearised(start, side).gradient
    off = jnp.where(pinned, 0.0, slope - jax.lax.stop_gradient(slope))
    fixed = jax.lax.stop_gradient(joint)
    own = fixed.curvature(pixels, side)
    stiffest = jnp.max(jnp.abs(own)) + jnp.max(6.0 * fixed.bend**2 + 2.0 * fixed.pace**2)
    ridge = jnp.where(open_, _OPEN_RIDGE * jnp.finfo(own.dtype).eps * stiffest, 0.0)
    own = own + jnp.diag(ridge)[None]
    return start - solve_hessian(own, fixed.bend, fixed.pace, ~pinned, off)
