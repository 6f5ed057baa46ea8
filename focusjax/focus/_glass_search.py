"""The best settings of a real lens for wishes, without derivatives.

At the settings that are reached so far, every point is exchanged for one that the thin lens blurs as the
glass blurs the point, by value and by slope with the focus, and the thin lens's problem is solved again: over
all sides, bounds, limits and priors (`search`, `find_optimum`). A few rounds settle. Newton's method on the
blur of the glass itself (`glass_blur`) makes it exact, with the bounds that are then active.
"""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax._entries import entries
from focusjax.focus._basin import basin_of, place_of
from focusjax.focus._bounds import Box
from focusjax.focus._glass_blur import GlassBlur, Sensed, blank_sensed, sensed
from focusjax.focus._glass_rows import GlassRows, Linear
from focusjax.focus._image_points import BLUR, SAME, ImagePoints, errors_of
from focusjax.focus._parameters import FOCUS, Start, scales
from focusjax.focus._search import Basin
from focusjax.focus._solution import Asked
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, SettableLens, is_tilted, settable

_ROUNDS = 5
"""Of the thin lens's problem, at most; the first is that of the points themselves."""
_AIMED_ANEW = (0, 2)
"""Rounds before which rays are aimed for the focus that is reached, as they are before Newton's method."""
_STEPS = 8
"""Of Newton's method, at most."""
_STEP_PX = 0.02
"""Change of the picture over which curvatures are taken, and that ends the rounds when one makes less."""
_SETTLED = 1e-3
"""Last step, in those over which curvatures are taken, at which the method has settled."""
_OPEN = 1e-9
"""Share of the largest curvature below which a direction is open."""
_SHAPE = jax.ShapeDtypeStruct


class Reached(eqx.Module):
    """Where the search is.

    Attributes:
        number: steps done.
        exact: whether the rounds are done and Newton's method goes on.
        basin: of the thin lens's problem.
        value: where rays look next.
        best: the best value that Newton's method has looked at, or the last.
        found: what rays say there, and next to it.
        cost: there.
        last: size of Newton's last step, in those over which curvatures are taken.
    """

    number: Int[Array, ""]
    exact: Bool[Array, ""]
    basin: Basin
    value: Float[Array, "k"]
    best: Float[Array, "k"]
    found: Sensed
    cost: Float[Array, ""]
    last: Float[Array, ""]


def best_settings(
    asked: Asked, glass: AbstractLens, widest: Float[Array, ""]
) -> tuple[Reached, SettableLens]:
    """The best settings, without derivatives, and the glass with its rays aimed for them.

    One loop has the rounds and Newton's method, so that rays are compiled once.
    """
    start, priors, box, first = place_of(asked)
    points, columns = asked.points, jnp.array(start.columns)
    unit, places = unit_steps(start), rows_and_references(points)

    def aim(value: Float[Array, "k"]) -> SettableLens:
        return settable(glass, asked.camera, start.whole(value)[FOCUS])

    def thin_again(state: Reached, found: Sensed) -> Reached:
        setting = start.setting(state.value)
        thin = exchanged(points, asked.camera, setting, jax.tree.map(lambda leaf: leaf[0], found))
        if not is_tilted(glass):
            thin = jax.tree.map(lambda a, b: jnp.where(state.number == 0, a, b), points, thin)
        basin = basin_of(dataclasses.replace(asked, points=thin))
        same = (state.number > 0) & (jnp.max(jnp.abs(basin.value - state.value) / unit) < 1.0)
        exact = same | (state.number + 1 == _ROUNDS)
        return dataclasses.replace(state, exact=exact, basin=basin, value=basin.value)

    def newton(state: Reached, found: Sensed) -> Reached:
        values = state.value[None] + _about(unit)
        linear = GlassRows(points).linear(found, values, columns, priors, unit)
        move = state.value - _inverse(linear, unit, state.basin, box) @ linear.gradient
        move = jnp.clip(move, box.lower, box.upper)
        last = jnp.max(jnp.abs(move - state.value) / unit)
        better = (linear.cost < state.cost) | (last < _SETTLED)
        keep = functools.partial(jax.tree.map, lambda new, old: jnp.where(better, new, old))
        best, seen, cost = keep((state.value, found, linear.cost), (state.best, state.found, state.cost))
        return dataclasses.replace(state, value=move, best=best, found=seen, cost=cost, last=last)

    def step(carry: tuple[Reached, SettableLens]) -> tuple[Reached, SettableLens]:
        state, aims = carry
        anew = jnp.any(state.number == jnp.array(_AIMED_ANEW)) | (state.exact & jnp.isinf(state.last))
        aims = jax.lax.cond(anew, lambda: eqx.filter(aim(state.value), eqx.is_array), lambda: aims)
        glass = eqx.combine(aims, fixed)
        # Focus and aperture radius of where rays look.
        settings = jax.vmap(start.setting)(state.value[None] + _about(unit))

        def look(at: Array, found: Sensed) -> Sensed:
            one = sensed(glass, asked.camera, widest, *places, settings[at][None])
            return jax.tree.map(lambda whole, row: whole.at[at].set(row[0]), found, one)

        # Rounds need no curvature. What is looked at in turn is compiled once.
        found = jax.lax.fori_loop(0, jnp.where(state.exact, len(settings), 1), look, unseen)
        state = jax.lax.cond(state.exact, newton, thin_again, state, found)
        return dataclasses.replace(state, number=state.number + 1), aims

    def moving(carry: tuple[Reached, SettableLens]) -> Bool[Array, ""]:
        state, _ = carry
        return (state.number < _ROUNDS + _STEPS) & (state.last > _SETTLED)

    shapes, fixed = eqx.partition(eqx.filter_eval_shape(aim, first), lambda leaf: isinstance(leaf, _SHAPE))
    sample = shapes, eqx.filter_eval_shape(basin_of, asked)
    blank, basin = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), sample)
    unseen = blank_sensed(1 + 2 * first.size, places[1])
    far = jnp.full_like(first[0], jnp.inf)
    state = Reached(jnp.array(0), jnp.array(False), basin, first, first, unseen, far, far)
    state, aims = jax.lax.while_loop(moving, step, (state, blank))
    return state, eqx.combine(aims, fixed)


def unit_steps(start: Start) -> Float[Array, "k"]:
    """Changes of the free parameters over which curvatures are taken."""
    return _STEP_PX / jax.lax.stop_gradient(entries(scales(start), start.columns))


def _about(unit: Float[Array, "k"]) -> Float[Array, "v k"]:
    """Steps to where rays look: none, one of each parameter beyond, and one before."""
    away = jnp.diag(unit)
    return jnp.concatenate([jnp.zeros_like(unit)[None], away, -away])


def exchanged(points: ImagePoints, camera: Camera, setting: Float[Array, "2"], found: Sensed) -> ImagePoints:
    """Points that the thin lens blurs as the glass blurs those given, about what is reached."""
    own, other = own_and_other(found.blur, points)
    slope = found.slope.defocus[: points.disparity.shape[0], 0]
    gain = 2.0 * camera.focal_px * setting[1]
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
    reference = jnp.concatenate([points.reference[:, :2], depth[:, None]], axis=1)
    return dataclasses.replace(changed, reference=reference)


def rows_and_references(points: ImagePoints) -> tuple[Float[Array, "m 2"], Float[Array, "m"]]:
    """Places in pixels and disparities of rows and, after them, of their references."""
    if points.reference is None:
        return points.xy, points.disparity
    other = points.reference
    return jnp.concatenate([points.xy, other[:, :2]]), jnp.concatenate([points.disparity, other[:, 2]])


def glass_errors(blur: GlassBlur, points: ImagePoints) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Signed blur and error in pixels of every row; rows that count and get no light have no error."""
    own, other = own_and_other(blur, points)
    error = errors_of(points, own.signed, None if other is None else other.signed)
    return own.signed, jnp.where((own.light > 0.0) | (points.weight == 0.0), error, jnp.nan)


def own_and_other(blur: GlassBlur, points: ImagePoints) -> tuple[GlassBlur, GlassBlur | None]:
    """Of rows, and of their references if there are any."""
    count = points.disparity.shape[0]
    own = jax.tree.map(lambda leaf: leaf[:count], blur)
    return own, None if points.reference is None else jax.tree.map(lambda leaf: leaf[count:], blur)


def _inverse(found: Linear, unit: Float[Array, "k"], basin: Basin, box: Box) -> Float[Array, "k k"]:
    """Inverse of the curvature over what may move; that of Gauss and Newton where it is not convex."""
    exact, convex = inverted(found.curvature, unit, basin, box)
    near, _ = inverted(found.normal, unit, basin, box)
    return jnp.where(convex, exact, near)


def inverted(
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
