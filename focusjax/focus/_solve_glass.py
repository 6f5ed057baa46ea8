"""Wishes met by a real lens: the thin lens's search, brought to what the glass blurs, and refined through it.

At the settings that are reached so far, every point is exchanged for one that the thin lens blurs as the
glass blurs the point, by value and by slope with the focus, and the thin lens's problem is solved again: over
all sides, bounds, limits and priors (`search`, `find_optimum`). A few rounds settle. Newton's method on the
blur of the glass itself (`glass_blur`), with the bounds that are then active, makes it exact; one more step
with derivatives carries those, by the implicit function theorem.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from focusjax.focus._basin import ended, place_of, thin_basin
from focusjax.focus._glass_blur import GlassBlur, sensed
from focusjax.focus._glass_rows import GlassRows, Linear, holding, placed
from focusjax.focus._image_points import BLUR, SAME, ImagePoints, errors_of
from focusjax.focus._parameters import FOCUS, RADIUS, scales
from focusjax.focus._search import Basin
from focusjax.focus._solution import Asked, Result, Solution
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, SettableLens, pupil_radius, refocused, settable, stopped

_ROUNDS = 4
_AIMED_ANEW = (0, 2)
"""Rounds before which rays are aimed for the focus that is reached."""
_STEPS = 8
"""Of Newton's method."""
_STEP_PX = 0.02
"""Change of the picture over which curvatures are taken."""
_SETTLED = 1e-5
"""Last step, in those over which curvatures are taken, at which the method has settled."""
_LOOKED_AT = 5
"""Settings that are looked at in one go: one, and two about it for either parameter, free or not."""
_OPEN = 1e-9
"""Share of the largest curvature below which a direction is open."""


def solve_through(asked: Asked) -> tuple[Solution, Bool[Array, ""]]:
    """The solution of one checked problem through its glass, and whether the solver failed."""
    glass, limits = asked.glass, asked.limits
    assert glass is not None
    widest = pupil_radius(glass)
    # No stop opens farther than the glass does.
    fastest = jnp.maximum(limits.f_number[0], asked.camera.focal_length / (2.0 * widest))
    limits = dataclasses.replace(limits, f_number=(fastest, jnp.maximum(limits.f_number[1], fastest)))
    radius = jnp.minimum(asked.lens.aperture_radius, widest)
    thin = eqx.tree_at(lambda lens: lens.aperture_radius, asked.lens, radius)
    asked = dataclasses.replace(asked, lens=thin, limits=limits, glass=None)
    still = jax.lax.stop_gradient(asked)
    start, _, _, _ = place_of(still)
    basin = thin_basin(still)
    aimed = settable(glass, asked.camera, start.whole(basin.value)[FOCUS])
    for number in range(_ROUNDS):
        setting = start.whole(basin.value)[jnp.array([FOCUS, RADIUS])]
        if number in _AIMED_ANEW:
            aimed = settable(glass, asked.camera, setting[0])
        own, other, slope = _at(still.points, jax.lax.stop_gradient(aimed), still.camera, widest, setting)
        points = _exchanged(still, setting, own, other, slope)
        basin = thin_basin(dataclasses.replace(still, points=points))
    solution, failed = _refined(asked, basin, aimed, widest)
    opening = solution.lens.aperture_radius / widest
    found = refocused(stopped(glass, opening), asked.camera, solution.lens.focus_disparity)
    return dataclasses.replace(solution, glass=found), failed


def _at(
    points: ImagePoints,
    glass: SettableLens,
    camera: Camera,
    widest: Float[Array, ""],
    setting: Float[Array, "2"],
) -> tuple[GlassBlur, GlassBlur | None, Float[Array, "n"]]:
    """Blur of rows and references at one setting, and the slope of the rows' defocus with the focus."""
    xy, disparity = _with_references(points)
    found = sensed(glass, camera, widest, xy, disparity, jnp.stack([setting] * _LOOKED_AT))
    count = points.disparity.shape[0]
    own = jax.tree.map(lambda leaf: leaf[0, :count], found.blur)
    slope = found.slope.defocus[0, :count, 0]
    if points.reference is None:
        return own, None, slope
    return own, jax.tree.map(lambda leaf: leaf[0, count:], found.blur), slope


def _with_references(points: ImagePoints) -> tuple[Float[Array, "m 2"], Float[Array, "m"]]:
    if points.reference is None:
        return points.xy, points.disparity
    other = points.reference
    return jnp.concatenate([points.xy, other[:, :2]]), jnp.concatenate([points.disparity, other[:, 2]])


def _exchanged(
    asked: Asked,
    setting: Float[Array, "2"],
    own: GlassBlur,
    other: GlassBlur | None,
    slope: Float[Array, "n"],
) -> ImagePoints:
    """Points that the thin lens blurs as the glass blurs those of the problem, about what is reached."""
    points = asked.points
    gain = 2.0 * asked.camera.focal_px * setting[1]
    related = jnp.zeros_like(points.wish) if points.relation is None else points.relation
    blurred = jnp.ones_like(points.signed) if points.quantity is None else points.quantity == BLUR
    ratio = slope / gain
    # References and those who follow them are compared as they are.
    scaled = blurred & (related != SAME) & (ratio > 0.0)
    ratio = jnp.where(scaled, ratio, 1.0)
    wanted = jnp.sqrt(jnp.maximum(points.target**2 - own.spot**2, 0.0)) * jnp.sign(points.target) / ratio
    size = jnp.where(related == SAME, own.signed, own.defocus)
    changed = dataclasses.replace(
        points,
        disparity=jnp.where(blurred, setting[0] - size / (ratio * gain), points.disparity),
        target=jnp.where(scaled, wanted, points.target),
        weight=points.weight * ratio**2,
    )
    if other is None or points.reference is None:
        return changed
    depth = setting[0] - other.signed / gain
    return dataclasses.replace(changed, reference=points.reference.at[:, 2].set(depth))


def _refined(
    asked: Asked, basin: Basin, glass: SettableLens, widest: Float[Array, ""]
) -> tuple[Solution, Bool[Array, ""]]:
    """Newton's method through the glass from a basin's bottom, and what it makes of the wishes."""
    points = asked.points
    start, priors, box, first = place_of(asked)
    still = jax.lax.stop_gradient
    low, high = still(box.lower), still(box.upper)
    own, other, _ = _at(still(points), still(glass), still(asked.camera), still(widest), still(
        start.whole(basin.value)[jnp.array([FOCUS, RADIUS])]))  # fmt: skip
    sign = jnp.where(own.defocus >= 0.0, 1.0, -1.0)
    other_sign = None if other is None else jnp.where(other.defocus >= 0.0, 1.0, -1.0)
    rows = GlassRows(points, sign, other_sign, holding(points, own.size))
    unit = _STEP_PX / still(scales(start)[jnp.array(start.columns)])
    moves = ~(basin.held | basin.at_lower | basin.at_upper) & (high > low)
    # What the wishes leave open stays where the search has it.
    closed = jnp.eye(unit.size, dtype=unit.dtype) - basin.open

    def linear(asked: Asked, rows: GlassRows, glass: SettableLens, widest: Array, at: Array) -> Linear:
        xy, disparity = _with_references(asked.points)
        start, priors, _, _ = place_of(asked)
        steps = jnp.concatenate([jnp.diag(unit), -jnp.diag(unit), jnp.zeros((5, unit.size))])
        values = at[None] + jnp.concatenate([jnp.zeros((1, unit.size)), steps])[:_LOOKED_AT]
        whole = jax.vmap(start.whole)(values)[:, jnp.array([FOCUS, RADIUS])]
        found = sensed(glass, asked.camera, widest, xy, disparity, whole)
        return rows.linear(found, values, jnp.array(start.columns), priors, unit)

    def step(asked: Asked, rows: GlassRows, glass: SettableLens, widest: Array, at: Array) -> Array:
        """A step of Newton's method; its derivative is that of the optimum, if `at` is one."""
        found = linear(asked, rows, glass, widest, at)
        return -still(_inverse(found, unit, moves, closed)) @ found.gradient

    fixed = still((asked, rows, glass, widest))
    value = still(basin.value)
    count = jnp.array(0)
    for _ in range(_STEPS):
        move = step(*fixed, value)
        value = jnp.clip(value + move, low, high)
        count = count + 1
        size = jnp.max(jnp.abs(move / unit))
        if not isinstance(size, Tracer) and float(size) < _SETTLED:
            break
    carried = step(asked, rows, glass, widest, value)
    value = value + carried - still(carried)
    # What a bound or nothing holds follows the bound or the start.
    value = jnp.where(basin.at_lower, box.lower, jnp.where(basin.at_upper, box.upper, value))
    free = basin.held & ~(basin.at_lower | basin.at_upper)
    value = value + jnp.where(free, first - still(first), 0.0)
    whole = start.whole(value)[jnp.array([FOCUS, RADIUS])]
    own, other, _ = _at(points, glass, asked.camera, widest, whole)
    error = errors_of(points, placed(points, own.signed), None if other is None else other.signed)
    # Without light there is no blur.
    error = jnp.where((own.light > 0.0) | (points.weight == 0.0), error, jnp.nan)
    priced = jnp.sum(priors(value) ** 2)
    return ended(points, start, basin, value, own.signed, error, priced, count, Result.solved)


def _inverse(
    found: Linear, unit: Float[Array, "k"], moves: Bool[Array, "k"], closed: Float[Array, "k k"]
) -> Float[Array, "k k"]:
    """Inverse of the curvature over what may move; that of Gauss and Newton where it is not convex."""
    scale = jnp.where(moves, unit, 0.0)
    ends = closed @ jnp.diag(scale)

    def inverted(matrix: Float[Array, "k k"]) -> tuple[Array, Array]:
        sizes, turns = jnp.linalg.eigh(ends @ matrix @ ends.T)
        good = sizes > _OPEN * jnp.max(jnp.abs(sizes))
        inverse = turns @ jnp.diag(jnp.where(good, 1.0 / jnp.where(good, sizes, 1.0), 0.0)) @ turns.T
        return ends.T @ inverse @ ends, jnp.all(sizes > -_OPEN * jnp.max(jnp.abs(sizes)))

    exact, convex = inverted(found.curvature)
    near, _ = inverted(found.normal)
    return jnp.where(convex, exact, near)


def defocus_slopes(
    glass: AbstractLens,
    camera: Camera,
    focus_disparity: Float[Array, ""],
    radius: Float[Array, ""],
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
) -> Float[np.ndarray, "n 2"]:
    """Change of defocus in pixels with focus disparity and aperture radius; the glass is wide open."""
    lens, widest = settable(glass, camera, focus_disparity), pupil_radius(glass)
    setting = jnp.stack([focus_disparity, radius])
    found = sensed(lens, camera, widest, xy, disparity, jnp.stack([setting] * _LOOKED_AT))
    return np.asarray(found.slope.defocus[0])


def seen_through(solution: Solution, glass: AbstractLens) -> Solution:
    """The solution of a thin lens with what its settings make of the wishes through `glass`, set alike."""
    points, focus = solution.points, solution.lens.focus_disparity
    widest = pupil_radius(glass)
    aimed = settable(glass, solution.camera, focus)
    own, other, _ = _at(points, aimed, solution.camera, widest, jnp.stack([focus, widest]))
    error = errors_of(points, placed(points, own.signed), None if other is None else other.signed)
    return dataclasses.replace(solution, blur=own.signed, error=error, glass=glass)
