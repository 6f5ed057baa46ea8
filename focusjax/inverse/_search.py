"""Where to start a fit: pictures of few rays through lenses all over the box."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from focusjax.inverse._blocks import SIZES, block_means
from focusjax.inverse._levels import Problem
from focusjax.inverse._variables import FOCUS, GAIN, PARAMETERS, RADIUS
from focusjax.trace import render

_RAYS = 4
_LEVEL = SIZES.index(2)
_TRIALS = {0: 0, 1: 4, 2: 5, 3: 6, 4: 7}
"""Lenses tried, as powers of two, by the number of settings that are free, gain apart."""


def best_starts(
    problem: Problem, in_sight: Float[np.ndarray, " n"], own: Float[Array, " k"], count: int
) -> list[Float[Array, " k"]]:
    """The variables of the `count` lenses that come closest to the target, out of many and the given one.

    Lenses are spread evenly (Sobol) over focus disparities of what is in sight, openings, and planes
    that lean no farther than the scene does. The best gain for each follows by linear least squares.

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
    square = points.random_base2(_TRIALS[dimensions])[:, :dimensions]
    upper = np.array(variables.upper)
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
    costs, gains = zip(*(_trial(problem, each) for each in tried), strict=True)
    order = np.argsort(np.array(costs), kind="stable")[:count]
    starts = [tried[number] for number in order]
    if PARAMETERS[GAIN] in variables.free:
        starts = [s.at[-1].set(jnp.log(gains[n])) for s, n in zip(starts, order, strict=True)]
    return starts


def _trial(problem: Problem, variables: Float[Array, " k"]) -> tuple[float, Array]:
    """The sum of squares over blocks with the best gain, and that gain, of a picture of few rays."""
    settings = _settings(problem, variables)
    lens = problem.variables.lens_at(settings)
    picture = render(problem.layers, lens, rays=_RAYS, even=True, seed=problem.seed)
    free = PARAMETERS[GAIN] in problem.variables.free
    cost, gain = _compared(picture, problem.target, problem.weight, settings[GAIN], gain_free=free)
    return float(cost), gain


@eqx.filter_jit
def _settings(problem: Problem, variables: Float[Array, " k"]) -> Float[Array, "5"]:
    return problem.variables.settings(variables, problem.layers)


@eqx.filter_jit
def _compared(
    picture: Float[Array, "h w 3"],
    target: Float[Array, "h w 3"],
    weight: Float[Array, "h w 3"],
    gain: Float[Array, ""],
    *,
    gain_free: bool,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    level = jnp.array(_LEVEL)
    shown, wanted = block_means(picture, weight, level), block_means(target, weight, level)
    if gain_free:
        energy = shown @ shown
        gain = jnp.maximum(shown @ wanted / jnp.where(energy > 0, energy, 1.0), 1e-6)
    return ((gain * shown - wanted) ** 2).sum(), gain
