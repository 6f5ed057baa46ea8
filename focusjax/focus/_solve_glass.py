"""Wishes met by a real lens (Lee10 5.1): the solution that `best_settings` finds, with its derivatives.

At the optimum x of wishes t the gradient g(x, t) is 0, so that dx/dt = - (dg/dx)^-1 dg/dt, by the implicit
function theorem, over what no bound holds.
"""

import dataclasses
import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax._programs import jit
from focusjax.focus._basin import basin_of, ended, place_of
from focusjax.focus._glass_blur import GlassBlur, Sensed, changes, numbers_of, of_row, row_of, sensed
from focusjax.focus._glass_rows import GlassRows
from focusjax.focus._glass_search import (
    Reached,
    best_settings,
    exchanged,
    glass_errors,
    inverted,
    own_and_other,
    rows_and_references,
    unit_steps,
)
from focusjax.focus._image_points import ImagePoints, errors_of
from focusjax.focus._search import Basin
from focusjax.focus._solution import Asked, Result, Solution
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, SettableLens, pupil_radius, refocused, settable, stopped

_EXCHANGES = 2
"""Of points for those of a thin lens, from one solution to that of other weights."""


def solve_through(asked: Asked) -> tuple[Solution, Bool[Array, ""]]:
    """The solution of one checked problem through its glass, and whether the solver failed."""
    glass = asked.glass
    assert glass is not None
    solution, failed = _solve(dataclasses.replace(asked, glass=None), glass)
    opening = solution.lens.aperture_radius / pupil_radius(glass)
    found = refocused(stopped(glass, opening), asked.camera, solution.lens.focus_disparity)
    return dataclasses.replace(solution, glass=found), failed


@jit
def _solve(asked: Asked, glass: AbstractLens) -> tuple[Solution, Bool[Array, ""]]:
    """The compiled part."""
    still = jax.lax.stop_gradient
    widest = pupil_radius(glass)
    asked = _no_wider(asked, widest)
    reached, aimed = best_settings(*still((asked, glass, widest)))
    return _carried(asked, reached, aimed, widest)


def _no_wider(asked: Asked, widest: Float[Array, ""]) -> Asked:
    """The problem with no stop opened farther than the glass is."""
    limits = asked.limits.no_wider(asked.camera, widest)
    radius = jnp.minimum(asked.lens.aperture_radius, widest)
    lens = eqx.tree_at(lambda lens: lens.aperture_radius, asked.lens, radius)
    return dataclasses.replace(asked, lens=lens, limits=limits)


@eqx.filter_custom_jvp
def _optimum(
    asked: Asked,
    widest: Float[Array, ""],
    glass: SettableLens,
    basin: Basin,
    value: Float[Array, "k"],
    found: Sensed,
) -> tuple[Float[Array, "k"], GlassBlur]:
    """`value`, where the gradient is 0, and the blur there, with the derivatives of the optimum.

    What bounds hold has the derivatives of `value`. Curvatures are those of the very place: rays that the rim
    lets in or cuts off make others of differences.
    """
    return value, found.blur


@_optimum.def_jvp
def _optimum_jvp(primals: tuple, tangents: tuple) -> tuple[tuple[Array, GlassBlur], tuple[Array, GlassBlur]]:
    asked, widest, glass, basin, value, found = primals
    start, _, box, _ = place_of(asked)

    def gradient(asked: Asked, value: Float[Array, "k"], found: Sensed) -> Float[Array, "k"]:
        start, priors, _, _ = place_of(asked)
        return GlassRows(asked.points).gradient(found, value, jnp.array(start.columns), priors)

    def followed(asked: Asked, widest: Float[Array, ""], value: Float[Array, "k"]) -> tuple:
        setting = place_of(asked)[0].setting(value)
        return asked.camera, widest, *rows_and_references(asked.points), setting

    by = changes(glass, *followed(asked, widest, value))

    def at(asked: Asked, widest: Float[Array, ""], value: Float[Array, "k"]) -> tuple[Array, Sensed]:
        """The gradient and what rays say, linear about the optimum in what they follow."""
        numbers = numbers_of(*followed(asked, widest, value))
        row = row_of(found) + jnp.einsum("noi,ni->no", by, numbers - jax.lax.stop_gradient(numbers))
        near = of_row(row)
        return gradient(asked, value, near), near

    curvature = jax.jacfwd(lambda value: at(asked, widest, value)[0])(value)
    inverse, _ = inverted(0.5 * (curvature + curvature.T), unit_steps(start), basin, box)
    _, (change, _) = eqx.filter_jvp(
        lambda asked, widest: at(asked, widest, value), (asked, widest), tuple(tangents[:2])
    )
    bound = jnp.zeros_like(value) if tangents[4] is None else tangents[4]
    move = bound - inverse @ (change + curvature @ bound)
    _, (_, follows) = eqx.filter_jvp(at, (asked, widest, value), (*tangents[:2], move))
    return (value, found.blur), (move, follows.blur)


def _carried(
    asked: Asked, reached: Reached, glass: SettableLens, widest: Float[Array, ""]
) -> tuple[Solution, Bool[Array, ""]]:
    """The solution with its derivatives."""
    still = jax.lax.stop_gradient
    start, priors, box, first = place_of(asked)
    basin, best = reached.basin, still(reached.best)
    # What a bound or nothing holds follows the bound or the start.
    low, high = box.lower - still(box.lower), box.upper - still(box.upper)
    follows = jnp.where(basin.held, first - still(first), 0.0)
    follows = jnp.where(basin.at_lower, low, jnp.where(basin.at_upper, high, follows))
    found = still(jax.tree.map(lambda leaf: leaf[0], reached.found))
    value, blur = _optimum(asked, widest, glass, basin, best + follows, found)
    signed, error = glass_errors(blur, asked.points)
    priced = jnp.sum(priors(value) ** 2)
    return ended(asked.points, start, basin, value, signed, error, priced, reached.number, Result.solved)


def defocus_slopes(
    glass: AbstractLens,
    camera: Camera,
    focus_disparity: Float[Array, ""],
    radius: Float[Array, ""],
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
) -> Float[np.ndarray, "n 2"]:
    """Change of defocus in pixels with focus disparity and aperture radius; the glass is wide open."""
    setting = jnp.stack([focus_disparity, radius])
    return np.asarray(_looked(glass, camera, xy, disparity, setting).slope.defocus)


def seen_through(solution: Solution, glass: AbstractLens) -> Solution:
    """The solution of a thin lens with what its settings make of the wishes through `glass`, set alike."""
    points = solution.points
    setting = jnp.stack([solution.lens.focus_disparity, pupil_radius(glass)])
    found = _looked(glass, solution.camera, *rows_and_references(points), setting)
    own, _ = own_and_other(found.blur, points)
    return dataclasses.replace(solution, blur=own.signed, error=_errors_of(points, found), glass=glass)


def solved_again(solution: Solution) -> Callable[[Float[Array, "n"]], Float[Array, "n"]]:
    """From weights of rows to their errors in pixels at nearly the best settings, through the same glass.

    About what is reached, points are exchanged for those that a thin lens blurs as the glass does
    (`exchanged`), twice. Errors are those of the glass where that leads, and stray from the least only by
    the square of how far that is from the best. Where `solution` is, the glass is looked through once.
    """
    asked = solution.asked
    assert asked is not None
    glass, points = asked.glass, asked.points
    assert glass is not None
    thin, places = dataclasses.replace(asked, glass=None), rows_and_references(points)
    start = jnp.stack([solution.lens.focus_disparity, solution.lens.aperture_radius])
    first = functools.cache(lambda: _looked(glass, asked.camera, *places, start))

    def errors(weight: Float[Array, "n"]) -> Float[Array, "n"]:
        changed = dataclasses.replace(thin, points=dataclasses.replace(points, weight=weight))
        setting, found = start, first()
        for _ in range(_EXCHANGES):
            setting = _thin_again(changed, glass, setting, found)
            found = _looked(glass, asked.camera, *places, setting)
        return _errors_of(changed.points, found)

    return errors


@jit
def _thin_again(
    asked: Asked, glass: AbstractLens, setting: Float[Array, "2"], found: Sensed
) -> Float[Array, "2"]:
    """The best setting of a thin lens that blurs as the glass does about `setting`."""
    asked = _no_wider(asked, pupil_radius(glass))
    thin = exchanged(asked.points, asked.camera, setting, found)
    basin = basin_of(dataclasses.replace(asked, points=thin))
    return place_of(asked)[0].setting(basin.value)


def _errors_of(points: ImagePoints, found: Sensed) -> Float[Array, "n"]:
    """Errors in pixels of rows whose blur rays say."""
    own, other = own_and_other(found.blur, points)
    return errors_of(points, own.signed, None if other is None else other.signed)


@jit
def _looked(
    glass: AbstractLens,
    camera: Camera,
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    setting: Float[Array, "2"],
) -> Sensed:
    """The blur of points at one setting of glass that is wide open."""
    aimed = settable(glass, camera, setting[0])
    found = sensed(aimed, camera, pupil_radius(glass), xy, disparity, setting[None])
    return jax.tree.map(lambda leaf: leaf[0], found)
