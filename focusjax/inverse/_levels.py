"""One level of a fit: least squares over blocks of one size, by Levenberg and Marquardt's method."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from focusjax._programs import jit
from focusjax.inverse._blocks import SIZES, block_means
from focusjax.inverse._variables import AbstractVariables
from focusjax.layers import Layers
from focusjax.trace import render

_SCALE = 10.0
"""Sizes of all residuals together where a picture has nothing of what the target shows. Damping is relative
to 1, so that first steps are nearly those of Gauss and Newton."""
_RELATIVE, _ABSOLUTE = 1e-3, 3e-4
"""Shares of variables and residuals below which a step is the last, where there is no noise."""
_LOST = 4.0
"""Squares of standard errors that a step may be and still be lost in noise."""
_SMALL = (1.0, 0.5)
"""Those of the last step, on each level."""


class Problem(eqx.Module):
    """A picture to fit.

    Attributes:
        layers: the known geometry.
        variables: what may change.
        target: linear picture.
        weight: one over the variance of each value of the target; 0 where it does not count.
        rays: rays per pixel (static).
        seed: chooses them (static).
    """

    layers: Layers
    variables: AbstractVariables
    target: Float[Array, "h w 3"]
    weight: Float[Array, "h w 3"]
    rays: int = eqx.field(static=True)
    seed: int = eqx.field(static=True)

    def picture(self, settings: Float[Array, " p"]) -> Float[Array, "h w 3"]:
        """What the lens of given settings forms, times the gain."""
        lens = self.variables.lens_at(settings)
        return settings[-1] * render(self.layers, lens, even=True, rays=self.rays, seed=self.seed)

    def weighed(self, weight: np.ndarray) -> "Problem":
        """The same with other weights."""
        return eqx.tree_at(lambda each: each.weight, self, jnp.asarray(weight, dtype=self.weight.dtype))

    def of_rays(self, rays: int) -> "Problem":
        """The same with pictures of another number of rays."""
        return Problem(self.layers, self.variables, self.target, self.weight, rays, self.seed)

    def of_seed(self, seed: int) -> "Problem":
        """The same with other rays."""
        return Problem(self.layers, self.variables, self.target, self.weight, self.rays, seed)

    def contrast(self) -> Float[Array, ""]:
        """Root of the sum of squares of the target about its mean, by weight."""
        total = self.weight.sum(axis=(0, 1))
        mean = (self.weight * self.target).sum(axis=(0, 1)) / jnp.where(total > 0, total, 1.0)
        return jnp.sqrt((self.weight * (self.target - mean[None, None]) ** 2).sum())


class Found(eqx.Module):
    """Where a level ended.

    Attributes:
        variables: of the lens.
        settings: of the lens.
        residual: picture less target.
        slopes: of the picture by the free settings.
        cost: half the sum of squares over blocks, relative to the target's contrast.
        steps: lenses tried.
        converged: whether the last steps were small, rather than too many.
    """

    variables: Float[Array, " k"]
    settings: Float[Array, " p"]
    residual: Float[Array, "h w 3"]
    slopes: Float[Array, "h w 3 k"]
    cost: Float[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


class _Steady(optx.AbstractSearch):
    """A trust region that also accepts steps whose effect is lost in noise.

    The picture is made of few rays and its slopes are those of infinitely many, so that near the optimum
    noise decides whether the next step seems to help: one that is refused is no sign of having arrived.
    """

    inner: optx.ClassicalTrustRegion
    noise: "_Noise"

    def init(self, y: Array, f_info_struct: Any) -> Any:
        return self.inner.init(y, f_info_struct)

    def step(
        self,
        first_step: Bool[Array, ""],
        y: Array,
        y_eval: Array,
        f_info: Any,
        f_eval_info: Any,
        state: Any,
    ) -> tuple[Array, Bool[Array, ""], optx.RESULTS, Any]:
        _, accept, result, after = self.inner.step(first_step, y, y_eval, f_info, f_eval_info, state)
        cost = f_info.as_min()
        gain = jnp.abs(self.inner.predict_reduction(y_eval - y, f_info))
        lost = (gain <= _LOST * self.noise.of_step(cost)) & ~accept
        lost &= f_eval_info.as_min() - cost <= self.noise.of_cost(cost)
        after = jax.tree.map(lambda new, old: jnp.where(lost, old, new), after, state)
        return after.step_size, accept | lost, result, after


class _Noise(eqx.Module):
    """How much of a cost is up to chance, at the optimum and if its residuals are noise.

    Attributes:
        residuals: how many there are.
        variables: how many there are (static).
    """

    residuals: Float[Array, ""]
    variables: int = eqx.field(static=True)

    def of_step(self, cost: Float[Array, ""]) -> Float[Array, ""]:
        """What a step of one standard error in every direction changes."""
        return self.variables * cost / self.residuals

    def of_cost(self, cost: Float[Array, ""]) -> Float[Array, ""]:
        """Three standard deviations of the cost itself."""
        return 3.0 * jnp.sqrt(2.0 / self.residuals) * cost


class _LevenbergMarquardt(optx.AbstractGaussNewton):
    """Levenberg and Marquardt's method, which ends when the next step is small against standard errors.

    It counts its own steps, so that one program serves any number of them.
    """

    noise: _Noise
    search: _Steady
    small: Float[Array, ""]
    most_steps: Int[Array, ""]
    rtol: float = _RELATIVE
    atol: float = _ABSOLUTE
    norm: Callable[[Any], Array] = optx.two_norm
    descent: optx.DampedNewtonDescent = eqx.field(
        default_factory=lambda: optx.DampedNewtonDescent(linear_solver=lx.QR())
    )
    verbose: Callable[..., None] = lambda **_: None

    def terminate(
        self, fn: Any, y: Array, args: Any, options: Any, state: Any, tags: Any
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        done, result = super().terminate(fn, y, args, options, state, tags)
        cost = state.f_info.as_min()
        # What the whole step would gain: a damped one is small for other reasons.
        slopes, residual = state.f_info.jac.as_matrix(), state.f_info.residual
        square, pull = slopes.T @ slopes, slopes.T @ residual
        ridge = 1e-6 * jnp.trace(square) + jnp.finfo(square.dtype).tiny
        gain = 0.5 * pull @ jnp.linalg.solve(square + ridge * jnp.eye(y.shape[0], dtype=y.dtype), pull)
        small = (state.num_steps_since_acceptance == 0) & (gain <= self.small * self.noise.of_step(cost))
        done |= ~state.first_step & small
        enough = state.num_steps >= self.most_steps
        ended = optx.RESULTS.where(enough & ~done, optx.RESULTS.nonlinear_max_steps_reached, result)
        return done | enough, ended


@jit
def fit_level(
    problem: Problem, start: Float[Array, " k"], level: Int[Array, ""], most_steps: Int[Array, ""]
) -> Found:
    """The least squares fit over the blocks of one level, from `start`.

    Picture and slopes are worked out together, by the same rays for all settings, and are all that a step
    needs: the residuals are taken as linear in the settings around each lens that is tried.
    """
    columns = jnp.array(problem.variables.columns)
    scale = _SCALE / problem.contrast()

    def with_slopes(settings: Float[Array, " p"]) -> tuple[Array, Array]:
        def both(part: Float[Array, " k"]) -> tuple[Array, Array]:
            picture = problem.picture(settings.at[columns].set(part))
            return picture, picture

        slopes, picture = jax.jacfwd(both, has_aux=True)(settings[columns])
        return picture, slopes

    def residuals(variables: Float[Array, " k"], _: Any) -> tuple[Array, tuple[Array, Array, Array]]:
        settings = problem.variables.settings(variables, problem.layers)
        still = jax.lax.stop_gradient(settings)
        picture, slopes = jax.lax.stop_gradient(with_slopes(still))
        moved = picture + slopes @ (settings - still)[columns]
        rows = scale * block_means(moved - problem.target, problem.weight, level)
        return rows, jax.lax.stop_gradient((settings, picture - problem.target, slopes))

    blocks = (problem.weight > 0).sum() / jnp.array(SIZES)[level] ** 2
    noise = _Noise(blocks.astype(scale.dtype), len(problem.variables.columns))
    search = _Steady(optx.ClassicalTrustRegion(high_cutoff=0.7), noise)
    small = jnp.array(_SMALL)[level]
    solver = _LevenbergMarquardt(noise=noise, search=search, small=small, most_steps=most_steps)
    solution = optx.least_squares(residuals, solver, start, has_aux=True, max_steps=None, throw=False)
    settings, residual, slopes = solution.state.aux
    return Found(
        variables=solution.value,
        settings=settings,
        residual=residual,
        slopes=slopes,
        cost=0.5 * (solution.state.f_info.residual**2).sum(),
        steps=solution.stats["num_steps"],
        converged=solution.result == optx.RESULTS.successful,
    )
