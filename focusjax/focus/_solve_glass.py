"""Wishes met by a real lens: the thin lens's search, brought to what the glass blurs, and refined through it.

At the settings that are reached so far, every point is exchanged for one that the thin lens blurs as the
glass blurs the point, by value and by slope with the focus, and the thin lens's problem is solved again: over
all sides, bounds, limits and priors (`search`, `find_optimum`). A few rounds settle. Newton's method on the
blur of the glass itself (`glass_blur`) makes it exact, with the bounds that are then active; its last step
alone has derivatives, which are those of the optimum by the implicit function theorem.
"""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._basin import basin_of, ended, place_of
from focusjax.focus._bounds import Box
from focusjax.focus._glass_blur import GlassBlur, Sensed, sensed
from focusjax.focus._glass_rows import GlassRows, Linear, diameters, placed
from focusjax.focus._image_points import BLUR, SAME, ImagePoints, errors_of
from focusjax.focus._parameters import FOCUS, RADIUS, Start, scales
from focusjax.focus._search import Basin
from focusjax.focus._solution import Asked, Result, Solution
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, SettableLens, pupil_radius, refocused, settable, stopped

_ROUNDS = 5
"""Of the thin lens's problem; the first is that of the points themselves."""
_AIMED_ANEW = (0, 2, _ROUNDS)
"""Steps before which rays are aimed for the focus that is reached."""
_STEPS = 8
"""Of Newton's method, at most."""
_STEP_PX = 0.02
"""Change of the picture over which curvatures are taken."""
_SETTLED = 1e-3
"""Last step, in those over which curvatures are taken, at which the method has settled."""
_OPEN = 1e-9
"""Share of the largest curvature below which a direction is open."""
_SHAPE = jax.ShapeDtypeStruct


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
    reached, aimed = _reached(*still((asked, glass, widest)))
    return _carried(asked, reached, aimed, widest)


def _no_wider(asked: Asked, widest: Float[Array, ""]) -> Asked:
    """The problem with no stop opened farther than the glass is."""
    limits = asked.limits
    fastest = jnp.maximum(limits.f_number[0], asked.camera.focal_length / (2.0 * widest))
    limits = dataclasses.replace(limits, f_number=(fastest, jnp.maximum(limits.f_number[1], fastest)))
    radius = jnp.minimum(asked.lens.aperture_radius, widest)
    lens = eqx.tree_at(lambda lens: lens.aperture_radius, asked.lens, radius)
    return dataclasses.replace(asked, lens=lens, limits=limits)


def _sensed(
    points: ImagePoints,
    glass: SettableLens,
    camera: Camera,
    widest: Float[Array, ""],
    settings: Float[Array, "v 2"],
) -> Sensed:
    """The blur of rows and, after them, of their references."""
    return sensed(glass, camera, widest, *_rows_and_references(points), settings)


def _rows_and_references(points: ImagePoints) -> tuple[Float[Array, "m 2"], Float[Array, "m"]]:
    """Places in pixels and disparities of rows and, after them, of their references."""
    if points.reference is None:
        return points.xy, points.disparity
    other = points.reference
    return jnp.concatenate([points.xy, other[:, :2]]), jnp.concatenate([points.disparity, other[:, 2]])


def _own_and_other(blur: GlassBlur, points: ImagePoints) -> tuple[GlassBlur, GlassBlur | None]:
    """Of rows, and of their references if there are any."""
    count = points.disparity.shape[0]
    own = jax.tree.map(lambda leaf: leaf[:count], blur)
    return own, None if points.reference is None else jax.tree.map(lambda leaf: leaf[count:], blur)


def _exchanged(asked: Asked, setting: Float[Array, "2"], found: Sensed) -> ImagePoints:
    """Points that the thin lens blurs as the glass blurs those of the problem, about what is reached."""
    own, other = _own_and_other(found.blur, asked.points)
    slope = found.slope.defocus[: asked.points.disparity.shape[0], 0]
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


class _Reached(eqx.Module):
    """Where the search is.

    Attributes:
        number: steps done.
        basin: of the thin lens's problem.
        value: where rays look next.
        best: the best value that Newton's method has looked at, or the last.
        found: what rays say there, and next to it.
        cost: there.
        last: size of Newton's last step, in those over which curvatures are taken.
    """

    number: Int[Array, ""]
    basin: Basin
    value: Float[Array, "k"]
    best: Float[Array, "k"]
    found: Sensed
    cost: Float[Array, ""]
    last: Float[Array, ""]


def _reached(asked: Asked, glass: AbstractLens, widest: Float[Array, ""]) -> tuple[_Reached, SettableLens]:
    """The best settings, without derivatives, and the glass with its rays aimed for them.

    One loop has the rounds and Newton's method, so that rays are compiled once.
    """
    start, priors, box, first = place_of(asked)
    points, columns = asked.points, jnp.array(start.columns)
    unit = _unit(start)

    def aim(value: Float[Array, "k"]) -> SettableLens:
        return settable(glass, asked.camera, start.whole(value)[FOCUS])

    def thin_again(state: _Reached, found: Sensed) -> _Reached:
        setting = start.whole(state.value)[jnp.array([FOCUS, RADIUS])]
        exchanged = _exchanged(asked, setting, jax.tree.map(lambda leaf: leaf[0], found))
        exchanged = jax.tree.map(lambda a, b: jnp.where(state.number == 0, a, b), points, exchanged)
        basin = basin_of(dataclasses.replace(asked, points=exchanged))
        return dataclasses.replace(state, basin=basin, value=basin.value)

    def newton(state: _Reached, found: Sensed) -> _Reached:
        values = state.value[None] + _about(unit)
        linear = GlassRows(points).linear(found, values, columns, priors, unit)
        move = state.value - _inverse(linear, unit, state.basin, box) @ linear.gradient
        move = jnp.clip(move, box.lower, box.upper)
        last = jnp.max(jnp.abs(move - state.value) / unit)
        better = (linear.cost < state.cost) | (last < _SETTLED)
        keep = functools.partial(jax.tree.map, lambda new, old: jnp.where(better, new, old))
        best, seen, cost = keep((state.value, found, linear.cost), (state.best, state.found, state.cost))
        return dataclasses.replace(state, value=move, best=best, found=seen, cost=cost, last=last)

    def step(carry: tuple[_Reached, SettableLens]) -> tuple[_Reached, SettableLens]:
        state, aims = carry
        anew = jnp.any(state.number == jnp.array(_AIMED_ANEW))
        aims = jax.lax.cond(anew, lambda: eqx.filter(aim(state.value), eqx.is_array), lambda: aims)
        found = _sensed(points, eqx.combine(aims, fixed), asked.camera, widest, _settings(start, state.value))
        state = jax.lax.cond(state.number < _ROUNDS, thin_again, newton, state, found)
        return dataclasses.replace(state, number=state.number + 1), aims

    def moving(carry: tuple[_Reached, SettableLens]) -> Bool[Array, ""]:
        state, _ = carry
        return (state.number < _ROUNDS + _STEPS) & (state.last > _SETTLED)

    shapes, fixed = eqx.partition(eqx.filter_eval_shape(aim, first), lambda leaf: isinstance(leaf, _SHAPE))
    sample = eqx.filter_eval_shape(
        lambda: (
            basin_of(asked),
            _sensed(points, aim(first), asked.camera, widest, _settings(start, first)),
        )
    )
    blank, basin, found = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), (shapes, *sample))
    far = jnp.full_like(first[0], jnp.inf)
    state = _Reached(jnp.array(0), basin, first, first, found, far, far)
    state, aims = jax.lax.while_loop(moving, step, (state, blank))
    return state, eqx.combine(aims, fixed)


def _unit(start: Start) -> Float[Array, "k"]:
    """Changes of the free parameters over which curvatures are taken."""
    return _STEP_PX / jax.lax.stop_gradient(scales(start)[jnp.array(start.columns)])


def _about(unit: Float[Array, "k"]) -> Float[Array, "v k"]:
    """Steps to where rays look: none, one of each parameter beyond, and one before."""
    away = jnp.diag(unit)
    return jnp.concatenate([jnp.zeros_like(unit)[None], away, -away])


def _settings(start: Start, value: Float[Array, "k"]) -> Float[Array, "v 2"]:
    """Focus and aperture radius of where rays look about `value`."""
    return jax.vmap(start.whole)(value[None] + _about(_unit(start)))[:, jnp.array([FOCUS, RADIUS])]


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
    return jax.tree.map(lambda leaf: leaf[0], _sensed(points, glass, camera, widest, setting[None]))


@eqx.filter_custom_jvp
def _optimum(
    asked: Asked, widest: Float[Array, ""], glass: SettableLens, basin: Basin, value: Float[Array, "k"]
) -> Float[Array, "k"]:
    """`value`, where the gradient is 0, with the derivatives that the implicit function theorem gives it.

    Curvatures are those of the very place: rays that the rim lets in or cuts off make others of differences.
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
    unit = _unit(start)
    curvature = jax.jacfwd(lambda value: gradient(asked, widest, value))(value)
    inverse, _ = _inverted(0.5 * (curvature + curvature.T), unit, basin, box)
    _, change = eqx.filter_jvp(
        lambda asked, widest: gradient(asked, widest, value), (asked, widest), tuple(tangents[:2])
    )
    return value, -inverse @ change


def _carried(
    asked: Asked, reached: _Reached, glass: SettableLens, widest: Float[Array, ""]
) -> tuple[Solution, Bool[Array, ""]]:
    """The solution with its derivatives."""
    still = jax.lax.stop_gradient
    start, priors, box, first = place_of(asked)
    basin, columns = reached.basin, jnp.array(start.columns)
    value = still(reached.best)
    setting = start.whole(value)[jnp.array([FOCUS, RADIUS])]
    found = jax.tree.map(lambda leaf: leaf[0], reached.found)
    found = _known(asked.points, glass, asked.camera, widest, setting, found)
    move = _optimum(asked, widest, glass, basin, value) - value
    # What a bound or nothing holds follows the bound or the start.
    low, high = box.lower - still(box.lower), box.upper - still(box.upper)
    move = jnp.where(basin.at_lower, low, jnp.where(basin.at_upper, high, move))
    is_free = basin.held & ~(basin.at_lower | basin.at_upper)
    move = jnp.where(is_free, first - still(first), move)
    value = value + move
    size, slope = diameters(found)
    own = size + slope[:, columns] @ move
    own = jnp.where(found.blur.defocus >= 0.0, own, -own)
    points, count = asked.points, asked.points.disparity.shape[0]
    light, other = found.blur.light[:count], None if points.reference is None else own[count:]
    error = errors_of(points, placed(points, own[:count]), other)
    # Without light there is no blur.
    error = jnp.where((light > 0.0) | (points.weight == 0.0), error, jnp.nan)
    priced = jnp.sum(priors(value) ** 2)
    return ended(points, start, basin, value, own[:count], error, priced, reached.number, Result.solved)


def _inverse(found: Linear, unit: Float[Array, "k"], basin: Basin, box: Box) -> Float[Array, "k k"]:
    """Inverse of the curvature over what may move; that of Gauss and Newton where it is not convex."""
    exact, convex = _inverted(found.curvature, unit, basin, box)
    near, _ = _inverted(found.normal, unit, basin, box)
    return jnp.where(convex, exact, near)


def _inverted(
    matrix: Float[Array, "k k"], unit: Float[Array, "k"], basin: Basin, box: Box
) -> tuple[Float[Array, "k k"], Bool[Array, ""]]:
    """The inverse over what may move, and whether the matrix is convex there."""
    moves = ~(basin.held | basin.at_lower | basin.at_upper) & (box.upper > box.lower)
    # What the wishes leave open stays where the search has it.
    closed = jnp.eye(unit.size, dtype=unit.dtype) - basin.open
    ends = closed @ jnp.diag(jnp.where(moves, unit, 0.0))
    sizes, turns = jnp.linalg.eigh(ends @ matrix @ ends.T)
    good = sizes > _OPEN * jnp.max(jnp.abs(sizes))
    inverse = turns @ jnp.diag(jnp.where(good, 1.0 / jnp.where(good, sizes, 1.0), 0.0)) @ turns.T
    return ends.T @ inverse @ ends, jnp.all(sizes > -_OPEN * jnp.max(jnp.abs(sizes)))


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
    found = _looked(glass, camera, pupil_radius(glass), xy, disparity, setting)
    return np.asarray(found.slope.defocus[0])


def seen_through(solution: Solution, glass: AbstractLens) -> Solution:
    """The solution of a thin lens with what its settings make of the wishes through `glass`, set alike."""
    points, widest = solution.points, pupil_radius(glass)
    setting = jnp.stack([solution.lens.focus_disparity, widest])
    xy, disparity = _rows_and_references(points)
    found = _looked(glass, solution.camera, widest, xy, disparity, setting)
    own, other = _own_and_other(jax.tree.map(lambda leaf: leaf[0], found.blur), points)
    error = errors_of(points, placed(points, own.signed), None if other is None else other.signed)
    return dataclasses.replace(solution, blur=own.signed, error=error, glass=glass)


@eqx.filter_jit
def _looked(
    glass: AbstractLens,
    camera: Camera,
    widest: Float[Array, ""],
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    setting: Float[Array, "2"],
) -> Sensed:
    """The blur of points at one setting."""
    return sensed(settable(glass, camera, setting[0]), camera, widest, xy, disparity, setting[None])
