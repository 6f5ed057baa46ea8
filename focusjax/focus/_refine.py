"""The two methods that solve the least-squares problem once every wish has chosen its side."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._global import Optimum
from focusjax.focus._image_points import ImagePoints, blurs, root_weight
from focusjax.focus._jaxopt import least_squares_in_box
from focusjax.focus._solution import Result
from focusjax.geometry import Camera
from focusjax.lens import ThinLens

Answer: TypeAlias = tuple[Float[Array, "2"], Int[Array, ""], Result]

# Levenberg-Marquardt damps relative to steps of 1. With variables that change the residuals by this
# many pixels per unit, damping is negligible from the start and its steps are those of Gauss-Newton.
_GAIN = 1e3

# Levenberg-Marquardt ends when steps and changes of residuals are below this many roundings.
_ROUNDINGS = 1e3


class Problem(eqx.Module):
    """Blur minus target at every point as a function of (focus disparity, aperture radius).

    Attributes:
        points: the wishes.
        camera: the pinhole that frames the picture.
        lens: the lens of which two parameters are varied.
        target: wished signed blur in pixels, with the side chosen for unsigned wishes.
    """

    points: ImagePoints
    camera: Camera
    lens: ThinLens
    target: Float[Array, "n"]

    def lens_at(self, value: Float[Array, "2"]) -> ThinLens:
        """The lens with `value` for its focus disparity in 1/m and aperture radius in m."""
        return eqx.tree_at(
            lambda lens: (lens.focus_disparity, lens.aperture_radius), self.lens, (value[0], value[1])
        )

    def residuals(self, value: Float[Array, "2"]) -> Float[Array, "n"]:
        """Square root of each point's share of the weight x error in pixels."""
        share = self.points.weight / jnp.sum(self.points.weight)
        return root_weight(share) * (blurs(self.points, self.camera, self.lens_at(value)) - self.target)

    def units(self, value: Float[Array, "2"]) -> Float[Array, "2"]:
        """How far each parameter must move from `value` to change the residuals by 1 px in all."""
        effect = jnp.linalg.norm(jax.jacfwd(self.residuals)(value), axis=0)
        return jax.lax.stop_gradient(1.0 / jnp.where(effect > 0.0, effect, 1.0))


class _Face(eqx.Module):
    """The part of the box where some parameters are pinned, in variables of `unit` each.

    The residuals have one more row per pinned variable, its distance from the pin: so the problem has
    full rank, and the derivative with respect to the pins (the bounds) is right, too.
    """

    problem: Problem
    unit: Float[Array, "2"]
    pinned: Bool[Array, "2"]
    pin: Float[Array, "2"]

    def value(self, variables: Float[Array, "2"]) -> Float[Array, "2"]:
        return jnp.where(self.pinned, self.pin, variables * self.unit)


def _residuals_on_face(variables: Float[Array, "2"], face: _Face) -> Float[Array, "m"]:
    off_pin = jnp.where(face.pinned, variables - face.pin / face.unit, 0.0)
    return jnp.concatenate([face.problem.residuals(face.value(variables)), off_pin])


def _by_optimistix(
    problem: Problem, optimum: Optimum, start: Float[Array, "2"], box: Box, max_steps: int
) -> Answer:
    """Levenberg-Marquardt on the face of the active bounds, from the optimum of the linear problem.

    Differentiable by the implicit function theorem: parameters on the face move with the points, and
    pinned ones with their bounds.
    """
    pin = jnp.where(optimum.at_lower, box.lower, jnp.where(optimum.at_upper, box.upper, start))
    pinned = optimum.at_lower | optimum.at_upper | optimum.held | (box.lower == box.upper)
    face = _Face(problem, _GAIN * problem.units(optimum.value), pinned, pin)
    tolerance = _ROUNDINGS * float(jnp.finfo(start.dtype).eps)
    found = optx.least_squares(
        _residuals_on_face,
        optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance),
        optimum.value / face.unit,
        args=face,
        max_steps=max_steps,
        throw=False,
    )
    result = Result.where(found.result == optx.RESULTS.successful, Result.solved, Result.not_finite)
    ran_out = found.result == optx.RESULTS.nonlinear_max_steps_reached
    return (
        face.value(found.value),
        jnp.asarray(found.stats["num_steps"]),
        Result.where(ran_out, Result.max_steps_reached, result),
    )


def _by_jaxopt(
    problem: Problem, optimum: Optimum, start: Float[Array, "2"], box: Box, max_steps: int
) -> Answer:
    """L-BFGS-B over the whole box from the starting lens; not differentiable.

    It shares with the first method the sides that wishes have chosen, not the active bounds.
    """
    lower = jnp.where(optimum.held, start, box.lower)
    upper = jnp.where(optimum.held, start, box.upper)
    unit = problem.units(optimum.value)
    variables, steps, converged = least_squares_in_box(
        lambda variables, args: args[0].residuals(variables * args[1]),
        start / unit,
        (problem, unit),
        lower / unit,
        upper / unit,
        tolerance=_ROUNDINGS * float(jnp.finfo(start.dtype).eps),
        max_steps=max_steps,
    )
    value = jax.lax.stop_gradient(variables * unit)
    return value, jnp.asarray(steps), Result.where(converged, Result.solved, Result.max_steps_reached)


METHODS: Mapping[str, Callable[[Problem, Optimum, Float[Array, "2"], Box, int], Answer]] = {
    "optimistix": _by_optimistix,
    "jaxopt": _by_jaxopt,
}
