"""Wishes met by a real lens (Lee10 5.1): the solution that `best_settings` finds, with its derivatives.

At the optimum x of wishes t the gradient g(x, t) is 0, so that dx/dt = - (dg/dx)^-1 dg/dt, by the implicit
function theorem, over what no bound holds.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax.focus._basin import ended, place_of
from focusjax.focus._glass_blur import Sensed, sensed
from focusjax.focus._glass_rows import GlassRows, diameters, placed
from focusjax.focus._glass_search import (
    Reached,
    best_settings,
    inverted,
    own_and_other,
    rows_and_references,
    sensed_rows,
    unit_steps,
)
from focusjax.focus._image_points import ImagePoints, errors_of
from focusjax.focus._parameters import FOCUS, RADIUS
from focusjax.focus._search import Basin
from focusjax.focus._solution import Asked, Result, Solution
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, SettableLens, pupil_radius, refocused, settable, stopped


def solve_through(asked: Asked) -> tuple[Solution, Bool[Array, ""]]:
    """The solution of one checked problem through its glass, and whether the solver failed."""
    glass = asked.glass
    assert glass is not None
    solution, failed = _solve(dataclasses.replace(asked, glass=None), glass)
    opening = solution.lens.aperture_radius / pupil_radius(glass)
    found = refocused(stopped(glass, opening), asked.camera, solution.lens.focus_disparity)
    return dataclasses.replace(solution, glass=found), failed


@eqx.filter_jit
def _solve(asked: Asked, glass: AbstractLens) -> tuple[Solution, Bool[Array, ""]]:
    """The compiled part."""
    still = jax.lax.stop_gradient
    widest = pupil_radius(glass)
    asked = _no_wider(asked, widest)
    reached, aimed = best_settings(*still((asked, glass, widest)))
    return _carried(asked, reached, aimed, widest)


def _no_wider(asked: Asked, widest: Float[Array, ""]) -> Asked:
    """The problem with no stop opened farther than the glass is."""
    limits = asked.limits
    fastest = jnp.maximum(limits.f_number[0], asked.camera.focal_length / (2.0 * widest))
    limits = dataclasses.replace(limits, f_number=(fastest, jnp.maximum(limits.f_number[1], fastest)))
    radius = jnp.minimum(asked.lens.aperture_radius, widest)
    lens = eqx.tree_at(lambda lens: lens.aperture_radius, asked.lens, radius)
    return dataclasses.replace(asked, lens=lens, limits=limits)


@eqx.filter_custom_jvp
def _known(
    points: ImagePoints,
    glass: SettableLens,
    camera: Camera,
    widest: Float[Array, ""],
    setting: Float[Array, "2"],
    found: Sensed,
) -> Sensed:
    """`found`, which rays say at one setting, with its derivatives, for which they are followed again."""
    return found


@_known.def_jvp
def _known_jvp(primals: tuple, tangents: tuple) -> tuple[Sensed, Sensed]:
    *inputs, found = primals
    return found, eqx.filter_jvp(_sensed_at, tuple(inputs), tuple(tangents[:-1]))[1]


def _sensed_at(
    points: ImagePoints,
    glass: SettableLens,
    camera: Camera,
    widest: Float[Array, ""],
    setting: Float[Array, "2"],
) -> Sensed:
    """The blur of rows and references at one setting."""
    return jax.tree.map(lambda leaf: leaf[0], sensed_rows(points, glass, camera, widest, setting[None]))


@eqx.filter_custom_jvp
def _optimum(
    asked: Asked, widest: Float[Array, ""], glass: SettableLens, basin: Basin, value: Float[Array, "k"]
) -> Float[Array, "k"]:
    """`value`, where the gradient is 0, with the derivatives that the implicit function theorem gives it.

    What bounds hold has the derivatives of `value`. Curvatures are those of the very place: rays that the rim
    lets in or cuts off make others of differences.
    """
    return value


@_optimum.def_jvp
def _optimum_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    asked, widest, glass, basin, value = primals

    def gradient(asked: Asked, widest: Float[Array, ""], value: Float[Array, "k"]) -> Float[Array, "k"]:
        start, priors, _, _ = place_of(asked)
        setting = start.whole(value)[jnp.array([FOCUS, RADIUS])]
        found = _sensed_at(asked.points, glass, asked.camera, widest, setting)
        return GlassRows(asked.points).gradient(found, value, jnp.array(start.columns), priors)

    start, _, box, _ = place_of(asked)
    curvature = jax.jacfwd(lambda value: gradient(asked, widest, value))(value)
    inverse, _ = inverted(0.5 * (curvature + curvature.T), unit_steps(start), basin, box)
    _, change = eqx.filter_jvp(
        lambda asked, widest: gradient(asked, widest, value), (asked, widest), tuple(tangents[:2])
    )
    bound = jnp.zeros_like(value) if tangents[4] is None else tangents[4]
    return value, bound - inverse @ (change + curvature @ bound)


def _carried(
    asked: Asked, reached: Reached, glass: SettableLens, widest: Float[Array, ""]
) -> tuple[Solution, Bool[Array, ""]]:
    """The solution with its derivatives."""
    still = jax.lax.stop_gradient
    start, priors, box, first = place_of(asked)
    basin, columns = reached.basin, jnp.array(start.columns)
    best = still(reached.best)
    # What a bound or nothing holds follows the bound or the start.
    low, high = box.lower - still(box.lower), box.upper - still(box.upper)
    follows = jnp.where(basin.held, first - still(first), 0.0)
    follows = jnp.where(basin.at_lower, low, jnp.where(basin.at_upper, high, follows))
    value = _optimum(asked, widest, glass, basin, best + follows)
    move = value - best
    setting = start.whole(best)[jnp.array([FOCUS, RADIUS])]
    found = jax.tree.map(lambda leaf: leaf[0], reached.found)
    found = _known(asked.points, glass, asked.camera, widest, setting, found)
    size, slope = diameters(found)
    # The move is nothing but derivatives: those of slopes would be multiplied by 0.
    own = size + still(slope[:, columns]) @ move
    own = jnp.where(found.blur.defocus >= 0.0, own, -own)
    points, count = asked.points, asked.points.disparity.shape[0]
    light, other = found.blur.light[:count], None if points.reference is None else own[count:]
    error = errors_of(points, placed(points, own[:count]), other)
    # Without light there is no blur.
    error = jnp.where((light > 0.0) | (points.weight == 0.0), error, jnp.nan)
    priced = jnp.sum(priors(value) ** 2)
    return ended(points, start, basin, value, own[:count], error, priced, reached.number, Result.solved)


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
    own, other = own_and_other(found.blur, points)
    error = errors_of(points, placed(points, own.signed), None if other is None else other.signed)
    return dataclasses.replace(solution, blur=own.signed, error=error, glass=glass)


@eqx.filter_jit
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
