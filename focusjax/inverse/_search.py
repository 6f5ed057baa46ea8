"""Where to start a fit: pictures of few rays through lenses all over the box."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.stats import qmc

from focusjax.inverse._blocks import SIZES, block_means
from focusjax.inverse._levels import Problem
from focusjax.inverse._variables import FOCUS, GAIN, PARAMETERS, RADIUS
from focusjax.trace import render_differentiable

_RAYS = 4
_LEVEL = SIZES.index(2)
_TRIALS = {0: 1, 1: 16, 2: 32, 3: 64, 4: 96}
"""Lenses tried, by the number of settings that are free, gain apart."""


def best_starts(
    problem: Problem, in_sight: Float[np.ndarray, " n"], own: Float[Array, " k"], count: int
) -> list[Float[Array, " k"]]:
    """The variables of the `count` lenses that come closest to the target, out of many and the given one.

    Lenses are spread evenly (Sobol) over focus disparities of what is in sight, openings, and planes that lean
    no farther than the scene does. The best gain for each follows by linear least squares.

    Args:
        problem: what to fit.
        in_sight: disparities of the surfaces that the fit is about.
        own: another lens to try.
        count: how many to give.
    """
    variables = problem.variables
    shares = [column for column in variables.columns if column != GAIN]
    dimensions = len(shares)
    points = qmc.Sobol(max(dimensions, 1), scramble=True, rng=np.random.default_rng(0))
    square = points.random(_TRIALS[dimensions])[:, :dimensions]
    lower, upper = np.array(variables.lower), np.array(variables.upper)
    least, largest = np.quantile(in_sight, [0.0, 1.0])
    most = min(1.1 * largest, upper[FOCUS])
    place = np.full((len(square), 5), 0.5)
    for axis, column in enumerate(shares):
        u = square[:, axis]
        if column == FOCUS:
            place[:, column] = (least / 1.2 + u * (most - least / 1.2)) / upper[FOCUS]
        elif column == RADIUS:
            place[:, column] = u
        else:
            # A plane that leans as far as the scene is deep.
            lean = min(1.0, (largest - least) / upper[FOCUS])
            place[:, column] = 0.5 + lean * (u - 0.5)
    turn = np.arcsin(np.clip(2.0 * place - 1.0, -0.99, 0.99))
    turn[:, GAIN] = 0.0
    tried = [jnp.asarray(row[list(variables.columns)], dtype=own.dtype) for row in turn] + [own]
    costs, gains = zip(*(_trial(problem, each, jnp.array(_LEVEL)) for each in tried), strict=True)
    order = np.argsort(np.array([float(cost) for cost in costs]), kind="stable")[:count]
    starts = [tried[number] for number in order]
    if PARAMETERS[GAIN] in variables.free:
        starts = [s.at[-1].set(jnp.log(gains[n])) for s, n in zip(starts, order, strict=True)]
    return starts


@eqx.filter_jit
def _trial(problem: Problem, variables: Float[Array, " k"], level: Int[Array, ""]) -> tuple[Array, Array]:
    """The sum of squares over blocks with the best gain, and that gain, of a picture of few rays."""
    settings = problem.variables.settings(variables, problem.layers)
    lens = problem.variables.lens_at(settings)
    picture = render_differentiable(problem.layers, lens, rays=_RAYS, seed=problem.seed)
    shown = block_means(picture, problem.weight, level)
    wanted = block_means(problem.target, problem.weight, level)
    gain = settings[GAIN]
    if PARAMETERS[GAIN] in problem.variables.free:
        energy = shown @ shown
        gain = jnp.maximum(shown @ wanted / jnp.where(energy > 0, energy, 1.0), 1e-6)
    return ((gain * shown - wanted) ** 2).sum(), gain
