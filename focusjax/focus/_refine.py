"""The methods that solve the smooth least-squares problem once sides and active bounds are known."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._image_points import SAME, ImagePoints, root_weight, values
from focusjax.focus._jaxopt import least_squares_in_box
from focusjax.focus._parameters import Start, scales
from focusjax.focus._priors import PriorRows
from focusjax.focus._search import Basin
from focusjax.focus._solution import Result

Answer: TypeAlias = tuple[Float[Array, "k"], Int[Array, ""], Result]

# Levenberg-Marquardt damps relative to steps of 1. With variables that change the residuals by this
# many pixels per unit, damping is negligible from the start and its steps are those of Gauss-Newton.
_GAIN = 1e3

# Both methods end when steps and changes of residuals are below this many roundings.
_ROUNDINGS = 1e3


class Problem(eqx.Module):
    """Errors at every point as a function of the free parameters, by the lens itself.

    Attributes:
        points: the wishes.
        start: the camera and lens of which some parameters are varied.
        priors: expectations.
        side: factor of every point's blur in its error.
        on: points that hold the solution.
    """

    points: ImagePoints
    start: Start
    priors: PriorRows
    side: Float[Array, "n"]
    on: Bool[Array, "n"]

    def residuals(self, value: Float[Array, "k"]) -> Float[Array, "m"]:
        """Square root of each row's share of the weight x error in pixels, points before expectations."""
        camera, lens = self.start.camera_at(value), self.start.lens_at(value)
        points = self.start.points_at(value, self.points)
        miss = self.side * values(points, camera, lens) - self.points.target
        if points.reference is not None:
            other = jax.vmap(lambda row: lens.blur(camera, row[:2], row[2]))(points.reference)
            miss = miss - jnp.where(points.relation == SAME, other, 0.0)
        total = jnp.sum(self.points.weight)
        rows = root_weight(self.points.weight / total) * jnp.where(self.on, miss, 0.0)
        return jnp.concatenate([rows, self.priors(value) / jnp.sqrt(total)])

    def units(self, value: Float[Array, "k"]) -> Float[Array, "k"]:
        """How far each parameter must move from `value` to change the residuals by 1 px in all."""
        effect = jnp.linalg.norm(jax.jacfwd(self.residuals)(value), axis=0)
        return jax.lax.stop_gradient(1.0 / jnp.where(effect > 0.0, effect, 1.0))


class _Face(eqx.Module):
    """The part of the box where some parameters are pinned, in variables of `unit` each.

    The residuals have one more row per parameter: for a pinned one its distance from the pin; for the others
    the slope, along directions that the wishes leave open, of half the squared change of the picture in
    pixels, |S (x - x_0)|^2 / 2, beyond the one that the search has `reached`: it is 0 where the picture
    changes least. So the problem has full rank, and the derivative with respect to the pins (the bounds) and
    to the start x_0 is right, too.

    What is open changes with x: it is the null space of the residuals' Jacobian J. To first order about the
    solution, with a projection P on it there, that is Z = P - J^+ J(x) P, with J^+ held.
    """

    problem: Problem
    unit: Float[Array, "k"]
    pinned: Bool[Array, "k"]
    pin: Float[Array, "k"]
    open: Float[Array, "k k"]
    inverse: Float[Array, "k m"]
    width: Float[Array, "k"]
    scale: Float[Array, "k"]
    first: Float[Array, "k"]
    reached: Float[Array, "k"]

    def value(self, variables: Float[Array, "k"]) -> Float[Array, "k"]:
        return jnp.where(self.pinned, self.pin, variables * self.unit)

    def along_open(self, value: Float[Array, "k"]) -> Float[Array, "k"]:
        """The slope of the change of the picture along what is open, over its largest factor."""
        if value.size == 1:
            # What is open of one parameter is all of it: then it is pinned.
            return jnp.zeros_like(value)
        jacobian = jax.jacfwd(self.problem.residuals)(value) * self.width[None]
        directions = self.open - self.inverse @ (jacobian @ self.open)
        pixels = self.scale * self.width
        slope = directions.T @ (pixels * self.scale * (value - self.first)) / jnp.max(pixels)
        return slope - self.reached


def _residuals_on_face(variables: Float[Array, "k"], face: _Face) -> Float[Array, "m"]:
    value = face.value(variables)
    off_pin = jnp.where(face.pinned, variables - face.pin / face.unit, 0.0)
    along_open = jnp.where(face.pinned, 0.0, face.along_open(value))
    return jnp.concatenate([face.problem.residuals(value), off_pin + along_open])


def _on_face(
    solver: Callable[[float], Any],
    problem: Problem,
    basin: Basin,
    first: Float[Array, "k"],
    box: Box,
    max_steps: int,
) -> Answer:
    """Least squares by Optimistix on the face of the active bounds, from the basin's bottom.

    Differentiable by the implicit function theorem: parameters on the face move with the points, pinned
    ones with their bounds, and what is left open with the starting lens.
    """
    import optimistix as optx

    kept = basin.value + (first - jax.lax.stop_gradient(first))
    low, high = (jax.lax.stop_gradient(end) for end in (box.lower, box.upper))
    # What is left open may rest on a bound that keeps it from the starting lens.
    start = jax.lax.stop_gradient(first)
    rests_low = basin.at_lower | (basin.held & (basin.value <= low) & (start < basin.value))
    rests_high = basin.at_upper | (basin.held & (basin.value >= high) & (start > basin.value))
    pin = jnp.where(rests_low, box.lower, jnp.where(rests_high, box.upper, kept))
    width = jnp.where(high > low, high - low, 1.0)
    pinned = rests_low | rests_high | (low == high)
    # Of one parameter what is open is all of it, and it stays as the start has it.
    stays = basin.held & ~pinned
    pinned = pinned | (stays & (first.size == 1))
    open_ = basin.open + jnp.diag(jnp.where(stays, 1.0, 0.0).astype(width.dtype))
    jacobian = jax.lax.stop_gradient(jax.jacfwd(problem.residuals)(basin.value)) * width[None]
    # With what is open filled up this has an inverse, and is that of what is not.
    size = jnp.maximum(jnp.max(jnp.sum(jacobian**2, axis=0)), jnp.finfo(width.dtype).tiny)
    filled = jacobian.T @ jacobian / size + open_
    ridge = jnp.finfo(width.dtype).eps * jnp.eye(width.size, dtype=width.dtype)
    face = _Face(
        problem=problem,
        unit=_GAIN * problem.units(basin.value),
        pinned=pinned,
        pin=pin,
        open=open_,
        inverse=jnp.linalg.solve(filled + ridge, jacobian.T / size),
        width=width,
        scale=scales(problem.start)[jnp.array(problem.start.columns)],
        first=first,
        reached=jnp.zeros_like(first),
    )
    reached = jax.lax.stop_gradient(face.along_open(basin.value))
    face = dataclasses.replace(face, reached=reached)
    found = optx.least_squares(
        _residuals_on_face,
        solver(_ROUNDINGS * float(jnp.finfo(first.dtype).eps)),
        basin.value / face.unit,
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


def _by_optimistix(
    problem: Problem, basin: Basin, first: Float[Array, "k"], box: Box, max_steps: int
) -> Answer:
    import optimistix as optx

    from focusjax.focus._forgiving import forgiving

    return _on_face(
        lambda tol: forgiving(optx.LevenbergMarquardt(rtol=tol, atol=tol)),
        problem, basin, first, box, max_steps,
    )  # fmt: skip


def _by_dogleg(problem: Problem, basin: Basin, first: Float[Array, "k"], box: Box, max_steps: int) -> Answer:
    import optimistix as optx

    from focusjax.focus._forgiving import forgiving

    return _on_face(
        lambda tol: forgiving(optx.Dogleg(rtol=tol, atol=tol)), problem, basin, first, box, max_steps
    )


def _by_jaxopt(problem: Problem, basin: Basin, first: Float[Array, "k"], box: Box, max_steps: int) -> Answer:
    """L-BFGS-B over the whole box from the starting lens; not differentiable.

    It shares with the other methods the sides that wishes have chosen and which limits hold, not the
    active bounds. What the wishes leave open stays where the search has it.
    """
    lower = jnp.where(basin.held, basin.value, box.lower)
    upper = jnp.where(basin.held, basin.value, box.upper)
    unit = problem.units(basin.value)
    width = jnp.where(box.upper > box.lower, box.upper - box.lower, 1.0)

    def residuals(variables: Float[Array, "k"], args: tuple) -> Float[Array, "m"]:
        problem, unit = args
        value = variables * unit
        return jnp.concatenate([problem.residuals(value), basin.open @ ((value - basin.value) / width)])

    variables, steps, converged = least_squares_in_box(
        residuals,
        jnp.clip(first, lower, upper) / unit,
        (problem, unit),
        lower / unit,
        upper / unit,
        tolerance=_ROUNDINGS * float(jnp.finfo(first.dtype).eps),
        max_steps=max_steps,
    )
    value = jax.lax.stop_gradient(variables * unit)
    return value, jnp.asarray(steps), Result.where(converged, Result.solved, Result.max_steps_reached)


METHODS: Mapping[str, Callable[[Problem, Basin, Float[Array, "k"], Box, int], Answer]] = {
    "optimistix": _by_optimistix,
    "dogleg": _by_dogleg,
    "jaxopt": _by_jaxopt,
}
