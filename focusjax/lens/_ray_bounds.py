"""Bounds on the rays of each film point of a real lens, from rays over a grid of film and pupil.

In tangents of the view, all rays of a film point at the radius r lie, at the disparity w, within

    A(r) + B(r) |w - w_0(r)|        of        a(r) + b(r) w,

with w_0 the disparity at which their spot is least. A and B are found at k radii from rays all over the
opening. Film points halfway between those are traced, too: twice what they exceed the interpolated disks by
is added to the neighbours, and 8 % for what lies between the rays.

Of a lens with a height field, which is not the same all around its axis, pupils and bounds are found along
many radii, with their mirror images, and what holds for all of them is kept.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.lens._length import Pair, root
from focusjax.lens._pupils import Pupils, Turn, at_place, find_pupils, from_film, openness, points_of
from focusjax.optics import HeightField, Prescription

STEEPEST = 6.0
"""Tangent to the axis beyond which no ray is taken: 80.5 degrees."""
MARGIN = 1.08
ROUNDING = 2e-6
_RADII = 8
"""Directions in which film points are examined, evenly around the axis."""


class RayBounds(eqx.Module):
    """Disks around the rays of film points, over k radii from the axis in equal steps.

    Attributes:
        at_infinity: a, tangent [k] along the radius.
        crossing: b, metres [k] along the radius.
        focus: w_0, 1/m [k].
        spot: A, tangent [k].
        spread: B, metres [k].
        radius: metres [k]; of the round opening whose blur has the same variance.
        beyond: share [k] of the opening that looks farther from the axis than rays are taken.
    """

    at_infinity: Float[Array, " k"]
    crossing: Float[Array, " k"]
    focus: Float[Array, " k"]
    spot: Float[Array, " k"]
    spread: Float[Array, " k"]
    radius: Float[Array, " k"]
    beyond: Float[Array, " k"]

    def at(self, place: Float[Array, ""]) -> "RayBounds":
        """Interpolated at a `place` counted in steps."""
        return at_place(self, place)


def exit_line(
    position: Float[Array, "3"], direction: Float[Array, "3"], pupil: Float[Array, ""]
) -> tuple[Pair, Pair]:
    """Slopes of a ray that left backwards, and where in mm it crosses the plane at `pupil`."""
    inverse, beyond = -1.0 / direction[2], pupil - position[2]
    x, y = direction[0] * inverse, direction[1] * inverse
    return (x, y), (position[0] - x * beyond, position[1] - y * beyond)


def find_bounds(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    film_distance: Float[Array, ""],
    film_scale: Float[Array, ""],
    entrance_pupil: Float[Array, ""],
    pupils: Pupils,
    radii: Float[Array, " k"],
    turn: Turn | None = None,
) -> RayBounds:
    """Of `radii` (tangents, in equal steps, an odd number of them), every other one; see `RayBounds`.

    Film points are along the x axis, or where a `turn` takes it.
    """
    turned = (lambda x, y: (x, y)) if turn is None else turn
    back = (lambda x, y: (x, y)) if turn is None else turn.back

    def one(radius: Array, inside: Array, rim: Array) -> tuple[Array, ...]:
        x, y, area = points_of(inside, rim, (1.0,))
        film = turned(-film_scale * radius, jnp.zeros_like(radius))

        def ray(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
            # Film points are on the negative side here, so that they look to the positive one.
            found, _ = from_film(lens, indices, film_distance, film, turned(-x, y))
            line = exit_line(found.position, found.direction, entrance_pupil)
            slope, crossing = (jnp.stack(back(*pair)) for pair in line)
            flat = slope @ slope < STEEPEST**2
            open_ = openness(found.clearance + 1e-3)
            return slope, crossing * 1e-3, open_ * flat, open_ * ~flat

        slope, crossing, light, dark = jax.vmap(ray)(x, y)
        lost, kept = jnp.sum(dark * area), jnp.sum(light * area)
        beyond = lost / jnp.where(lost > 0.0, lost + kept, 1.0)
        # The other half of the opening mirrors this one.
        mirrored = jnp.array([1.0, -1.0], dtype=rim.dtype)
        slope, crossing = (jnp.concatenate([one, one * mirrored[None]]) for one in (slope, crossing))
        a, b, *rest, lit = disk_of_rays(slope, crossing, jnp.tile(light, 2), jnp.tile(area, 2))
        return jnp.where(lit, a[0], radius), b[0], *rest, lit, beyond

    *found, lit, beyond = jax.vmap(one)(radii, pupils.inside, pupils.rim)
    # Where no light comes, as where some comes last.
    nearest = jax.lax.cummax(jnp.where(lit, jnp.arange(radii.shape[0]), 0))
    bounds = RayBounds(*(column[nearest] for column in found), beyond=beyond)
    stretched = bounds.at_infinity * radii / jnp.where(radii[nearest] > 0.0, radii[nearest], 1.0)
    bounds = eqx.tree_at(
        lambda b: b.at_infinity, bounds, jnp.where(nearest > 0, stretched, bounds.at_infinity)
    )
    return _with_margins(bounds)


def disk_of_rays(
    slope: Float[Array, "r 2"],
    crossing: Float[Array, "r 2"],
    light: Float[Array, " r"],
    area: Float[Array, " r"],
) -> tuple[Array, ...]:
    """The disk around the rays of a film point: a [2], b [2], w_0, A, B, radius, and whether any ray counts.

    Slopes are tangents, crossings of the pupil's plane metres. Rays count whose light is above 0, in means by
    the area of the opening that they stand for.
    """
    lit = light > 0.0
    found = jnp.any(lit)
    weight = (light * area)[:, None]
    total = jnp.where(found, jnp.sum(weight), 1.0)

    def mean(values: Array) -> Array:
        return jnp.sum(weight * values, axis=0) / total

    def middle(values: Array) -> Array:
        largest, least = (
            jnp.max(jnp.where(lit[:, None], sign * values, -jnp.inf), axis=0) for sign in (1.0, -1.0)
        )
        return jnp.where(found, 0.5 * (largest - least), 0.0)

    off_slope, off_crossing = (one - mean(one)[None] for one in (slope, crossing))
    square, together = (jnp.sum(mean(off_crossing * one)) for one in (off_crossing, off_slope))
    focus = -together / jnp.where(square > 0.0, square, 1.0)
    sharp = slope + crossing * focus
    a, b = middle(sharp), middle(crossing)

    def farthest(values: Array) -> Array:
        return root(jnp.max(jnp.where(lit, jnp.sum(values**2, axis=1), 0.0)))

    spot, spread = farthest(sharp - a[None]), farthest(crossing - b[None])
    return a - b * focus, b, focus, spot, spread, root(2.0 * square), found


def _with_margins(fine: RayBounds) -> RayBounds:
    """Every other radius, with what those between exceed the interpolation by."""
    kept, between = (jax.tree.map(lambda leaf, s=start: leaf[s::2], fine) for start in (0, 1))
    guess = jax.tree.map(lambda leaf: 0.5 * (leaf[:-1] + leaf[1:]), kept)
    b_off = between.crossing - guess.crossing
    a_off = between.at_infinity - guess.at_infinity + b_off * guess.focus
    spot = jnp.abs(a_off) + jnp.maximum(between.spot - guess.spot, 0.0)
    spot = spot + between.spread * jnp.abs(between.focus - guess.focus)
    spread = jnp.abs(b_off) + jnp.maximum(between.spread - guess.spread, 0.0)

    def widened(values: Array, excess: Array) -> Array:
        beside = jnp.maximum(jnp.append(excess, 0.0), jnp.append(0.0, excess))
        return MARGIN * values + 2.0 * beside

    return eqx.tree_at(
        lambda b: (b.spot, b.spread),
        kept,
        (widened(kept.spot, spot) + ROUNDING, widened(kept.spread, spread)),
    )


def is_round(lens: Prescription) -> bool:
    """Whether all surfaces are of revolution."""
    return not any(isinstance(surface, HeightField) for surface in lens.surfaces)


@jit
def find_all_around(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    film: Float[Array, ""],
    scale: Float[Array, ""],
    pupil: Float[Array, ""],
    radii: Float[Array, " k"],
) -> tuple[Pupils, RayBounds]:
    """As `find_pupils` and `find_bounds`, for film points in every direction from the axis."""
    angles = np.repeat(np.linspace(0.0, 2.0 * np.pi, _RADII, endpoint=False), 2)
    sides = np.tile([1.0, -1.0], _RADII)
    turns = Turn(*(jnp.asarray(each, radii.dtype) for each in (np.cos(angles), np.sin(angles), sides)))

    def along(turn: Turn) -> tuple[Pupils, RayBounds]:
        pupils = find_pupils(lens, indices, film, scale * radii, turn)
        return pupils, find_bounds(lens, indices, film, scale, pupil, pupils, radii, turn)

    pupils, bounds = jax.lax.map(along, turns)
    return _covering(pupils), _enclosing(bounds)


def _covering(each: Pupils) -> Pupils:
    """Ellipses around those of all directions [d, k]."""
    centre = each.centre.mean(axis=0, keepdims=True)
    wider = 1.0 + jnp.abs(each.centre - centre) / jnp.where(each.radial > 0.0, each.radial, 1.0)
    return Pupils(
        centre=centre[0],
        radial=jnp.max(each.radial * wider, axis=0),
        tangential=jnp.max(each.tangential * wider, axis=0),
        inside=each.inside[0],
        rim=each.rim[0],
        open=each.open.any(axis=0),
    )


def _enclosing(each: RayBounds) -> RayBounds:
    """Disks around those of all directions [d, k]."""
    middle = jax.tree.map(lambda leaf: leaf.mean(axis=0, keepdims=True), each)
    b_off = each.crossing - middle.crossing
    a_off = each.at_infinity - middle.at_infinity + b_off * middle.focus
    spot = each.spot + jnp.abs(a_off) + each.spread * jnp.abs(each.focus - middle.focus)
    return eqx.tree_at(
        lambda bounds: (bounds.spot, bounds.spread, bounds.beyond),
        jax.tree.map(lambda leaf: leaf[0], middle),
        (spot.max(axis=0), (each.spread + jnp.abs(b_off)).max(axis=0), each.beyond.max(axis=0)),
    )
