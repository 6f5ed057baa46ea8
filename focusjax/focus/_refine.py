"""The smooth least-squares problem once sides and active bounds are known, solved by Optimistix."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._image_points import root_weight
from focusjax.focus._objective import Objective
from focusjax.focus._search import Basin
from focusjax.focus._solution import Result

_ROUNDINGS = 1e3
"""The solve ends when steps and changes of residuals are below this many roundings."""


class Problem(eqx.Module):
    """Errors at every point as a smooth function of the free parameters.

    Attributes:
        objective: the wishes and expectations, with derivatives.
        side: factor of every point's blur in its error.
        on: points that hold the solution.
    """

    objective: Objective
    side: Float[Array, "n"]
    on: Bool[Array, "n"]

    def residuals(self, value: Float[Array, "k"]) -> Float[Array, "m"]:
        """Square root of each row's share of the weight x error in pixels, points before expectations."""
        objective = self.objective
        miss = jnp.where(self.on, objective.excess(value, self.side), 0.0)
        priors = jnp.sqrt(objective.prior_share) * objective.priors(value)
        return jnp.concatenate([root_weight(objective.share) * miss, priors])

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
    solution, with a projection P on it there, that is Z = P - J^+ J(x) P, with J^+ held. Derivatives go by Z,
    and so do solvers that start elsewhere; from the solution, where P is Z, P will do.
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

    def residuals(self, variables: Float[Array, "k"], *, turning: bool) -> Float[Array, "m"]:
        """All rows, with Z if `turning`, and else with P for what is open."""
        value = self.value(variables)
        rows = self.problem.residuals(value)
        along = jnp.where(self.pinned, variables - self.pin / self.unit, 0.0)
        # What is open of one parameter is all of it: then it is pinned.
        if value.size > 1:
            directions = self._directions(value) if turning else self.open
            along = along + jnp.where(self.pinned, 0.0, self.slope(directions, value) - self.reached)
        return jnp.concatenate([rows, along])

    def condition(self, variables: Float[Array, "k"]) -> Float[Array, "k"]:
        """The slope of half the sum of squares, which is 0 at the solution."""
        from focusjax.solvers import half_squares

        return jax.grad(lambda at: half_squares(self.residuals(at, turning=True)))(variables)

    def slope(self, directions: Float[Array, "k k"], value: Float[Array, "k"]) -> Float[Array, "k"]:
        """The slope of the change of the picture along what is open, over its largest factor."""
        pixels = self.scale * self.width
        return directions.T @ (pixels * self.scale * (value - self.first)) / jnp.max(pixels)

    def _directions(self, value: Float[Array, "k"]) -> Float[Array, "k k"]:
        """Z."""
        jacobian = jax.jacfwd(self.problem.residuals)(value) * self.width[None]
        return self.open - self.inverse @ (jacobian @ self.open)


def _near_rows(variables: Float[Array, "k"], face: _Face) -> Float[Array, "m"]:
    return face.residuals(variables, turning=False)


def _far_rows(variables: Float[Array, "k"], face: _Face) -> Float[Array, "m"]:
    return face.residuals(variables, turning=True)


def refined(
    problem: Problem, basin: Basin, first: Float[Array, "k"], box: Box, solver: Any, max_steps: int
) -> tuple[Float[Array, "k"], Int[Array, ""], Result]:
    """Least squares on the face of the active bounds: the parameters, the steps, and how it ended.

    Differentiable by the implicit function theorem: parameters on the face move with the points, pinned
    ones with their bounds, and what is left open with the starting lens, `first`. From that a `solver` of
    Optimistix starts; None is `BoundedLevenbergMarquardt` from the basin's bottom.
    """
    import optimistix as optx

    from focusjax.solvers import BoundedLevenbergMarquardt, ConditionAdjoint

    face = _face(problem, basin, first, box)
    tolerance = _ROUNDINGS * float(jnp.finfo(first.dtype).eps)
    start = basin.value if solver is None else jnp.where(basin.held, basin.value, first)
    free = ~jax.lax.stop_gradient(face.pinned)
    found = optx.least_squares(
        _near_rows if solver is None else _far_rows,
        BoundedLevenbergMarquardt(tolerance, tolerance) if solver is None else solver,
        jax.lax.stop_gradient(jnp.where(face.pinned, face.pin, start) / face.unit),
        args=face,
        # For solvers that know bounds.
        options={
            "lower": jnp.where(free, jax.lax.stop_gradient(box.lower / face.unit), -jnp.inf),
            "upper": jnp.where(free, jax.lax.stop_gradient(box.upper / face.unit), jnp.inf),
        },
        max_steps=max_steps,
        adjoint=ConditionAdjoint(),
        throw=False,
    )
    result = Result.where(found.result == optx.RESULTS.successful, Result.solved, Result.not_finite)
    ran_out = found.result == optx.RESULTS.nonlinear_max_steps_reached
    return (
        face.value(found.value),
        jnp.asarray(found.stats["num_steps"]),
        Result.where(ran_out, Result.max_steps_reached, result),
    )


def _face(problem: Problem, basin: Basin, first: Float[Array, "k"], box: Box) -> _Face:
    """The face that the basin's bottom lies on."""
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
        unit=problem.units(basin.value),
        pinned=pinned,
        pin=pin,
        open=open_,
        inverse=jnp.linalg.solve(filled + ridge, jacobian.T / size),
        width=width,
        scale=problem.objective.scale,
        first=first,
        reached=jnp.zeros_like(first),
    )
    return dataclasses.replace(face, reached=jax.lax.stop_gradient(face.slope(open_, basin.value)))
