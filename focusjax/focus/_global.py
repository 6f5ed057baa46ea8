"""The best focus and aperture of all, found by solving every linear problem the wishes can become.

With k = 2 f the blur of a point at disparity w is k E (u - w), for focus disparity u and aperture
radius E. Once every unsigned wish has chosen a side, its error is blur -+ d, and the sum of squares
is a convex quadratic in (E, E u), whose bounds form a convex quadrilateral. So for given sides:

- inside, the optimum is the line through (w, target) of weighted linear regression;
- otherwise it is on one of four edges, where one parameter is left, linear again, and clipped.

|blur| - d is the smaller of the two errors in size, and a point is behind the focus just when w < u,
so the best over the n + 1 ways to split the points by disparity is the best over all sides. No
iteration and no starting point is involved, hence no local minimum to fall into.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._image_points import ImagePoints

UNDETERMINED_PX = 0.01
"""A parameter whose whole range changes how wishes compare by less than this is left as it was."""

# Rounding steps that a computed blur may be off by, relative to its largest term.
_ROUNDING = 4.0

_RADII = 48
"""Steps of equal ratio over the range of the aperture."""


class Optimum(eqx.Module):
    """The best parameters, what holds them, and the linear problem that they solve.

    Attributes:
        value: focus disparity in 1/m and aperture radius in m.
        side: for every point, the factor (1 or -1) that makes its wished blur a signed one: 1 when the
            wish is signed, or the point of an unsigned wish is to be behind the focus.
        held: parameters that the wishes leave open, so they are where the start has them.
        at_lower: parameters that a lower bound keeps from a better value.
        at_upper: the same for upper bounds.
        open: projection, in parameters over their ranges, onto the direction in which both may change
            together without a change of any wish's blur.
    """

    value: Float[Array, "2"]
    side: Float[Array, "n"]
    held: Bool[Array, "2"]
    at_lower: Bool[Array, "2"]
    at_upper: Bool[Array, "2"]
    open: Float[Array, "2 2"]


class _Choice(eqx.Module):
    """The best value for one choice of sides, its cost in px^2, and what of that can be rounding."""

    value: Float[Array, "*split 2"]
    side: Float[Array, "*split n"]
    cost: Float[Array, "*split"]
    slack: Float[Array, "*split"]


class _Line(eqx.Module):
    """Points to fit with blur = slope E (u - w): everything but the targets."""

    slope: Float[Array, ""]
    disparity: Float[Array, "n"]
    share: Float[Array, "n"]

    def misses(
        self, value: Float[Array, "2"], target: Float[Array, "n"]
    ) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Blur - target for every point in pixels, and how much of that can be rounding."""
        focus, radius = value
        blur = self.slope * radius * (focus - self.disparity)
        size = self.slope * radius * (jnp.abs(focus) + jnp.abs(self.disparity)) + jnp.abs(target)
        return blur - target, _ROUNDING * jnp.finfo(blur.dtype).eps * size

    def focus(self, radius: Float[Array, ""], target: Float[Array, "n"]) -> Float[Array, ""]:
        """Best unbounded focus disparity for a given aperture."""
        mean = self.share @ self.disparity
        return mean + (self.share @ target) / (self.slope * radius)

    def radius(
        self, focus: Float[Array, ""], target: Float[Array, "n"], otherwise: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Best unbounded aperture radius for a given focus; `otherwise` if it makes no difference."""
        distance = focus - self.disparity
        return _ratio(self.share @ (target * distance), self.slope * (self.share @ distance**2), otherwise)

    def both(self, target: Float[Array, "n"], otherwise: Float[Array, ""]) -> Float[Array, ""]:
        """Aperture radius of the best unbounded pair; the regression's slope, around its centroid."""
        away = self.disparity - self.share @ self.disparity
        rise = target - self.share @ target
        return _ratio(-(self.share @ (rise * away)), self.slope * (self.share @ away**2), otherwise)


def find_optimum(
    points: ImagePoints,
    slope: Float[Array, ""],
    start: Float[Array, "2"],
    scale: Float[Array, "2"],
    box: Box,
    *,
    free_aperture: bool,
) -> Optimum:
    """The global optimum over the box, with a rule for every case that has several.

    - When all wishes are at one disparity, only E (u - w) matters: of all pairs that make it what is wished
      the one is taken that changes the picture least, in pixels (`scale`).
    - When blur does not depend on the focus (a pinhole), the focus stays as the start has it.
    - Of sides that are equally good to within rounding the one that changes the picture least, and of two
      that change it as much the nearer focus (near points settle ambiguities, Lee10 §5).

    Args:
        points: the wishes; at least one has positive weight.
        slope: blur in pixels per metre of radius and dioptre, 2 f.
        start: focus disparity in 1/m and aperture radius in m.
        scale: pixels per unit of each (see `scales`).
        box: bounds on both parameters.
        free_aperture: whether the aperture is solved for, too (static).
    """
    line = _Line(slope, points.disparity, points.weight / jnp.sum(points.weight))
    widest = jnp.where(free_aperture, box.upper[1], start[1])
    counted = points.weight > 0
    nearest = jnp.max(jnp.where(counted, points.disparity, -jnp.inf))
    farthest = jnp.min(jnp.where(counted, points.disparity, jnp.inf))
    one_plane = slope * widest * (nearest - farthest) < UNDETERMINED_PX
    pinhole = slope * widest * (box.upper[0] - box.lower[0]) < UNDETERMINED_PX

    def nearest_radius(side: Float[Array, ""]) -> Float[Array, ""]:
        """For wishes on one plane, of which all without a side are on that one."""
        return _nearest_radius(line, jnp.where(points.signed, 1.0, side) * points.target, start, scale, box)

    nearest = jax.vmap(nearest_radius)(jnp.array([1.0, -1.0], start.dtype)) if free_aperture else start

    def far(value: Float[Array, "2"]) -> Float[Array, ""]:
        """How much a value changes the picture, in pixels."""
        return jnp.linalg.norm(scale * (value - start))

    def best_for(nearest_behind: Float[Array, ""]) -> _Choice:
        """The best value with the points behind the focus that are farther than this disparity."""
        side = jnp.where(points.signed | (points.disparity < nearest_behind), 1.0, -1.0)
        target = side * points.target
        values = _candidates(line, target, start, nearest, box, free_aperture, pinhole)
        miss, noise = jax.vmap(line.misses, in_axes=(0, None))(values, target)
        cost = miss**2 @ line.share
        slack = (2.0 * jnp.abs(miss) * noise + noise**2) @ line.share
        if free_aperture:
            # The first three candidates keep the aperture or change it least: for wishes on one plane only.
            equal = cost - slack <= jnp.min(cost)
            change = jnp.where(equal, jax.vmap(far)(values), jnp.inf)
            others = jnp.where(np.arange(cost.size) < 3, jnp.inf, cost)
            chosen = jnp.where(one_plane, jnp.argmin(change), jnp.argmin(others))
        else:
            chosen = 0
        return _Choice(values[chosen], side, cost[chosen], slack[chosen])

    splits = jnp.append(points.disparity, jnp.inf)
    best = jax.vmap(best_for)(splits)
    equal = best.cost - best.slack <= jnp.min(best.cost)
    chosen = nearest_of(equal, jax.vmap(far)(best.value), best.value[:, 0])
    value, side = best.value[chosen], best.side[chosen]
    keeps = one_plane & (value[1] == start[1]) if free_aperture else jnp.array(False)
    held = jnp.stack([pinhole, keeps])
    down, up = _pushed(line, value, side * points.target)
    movable = ~held & jnp.array([True, free_aperture])
    at_lower = movable & (value <= box.lower) & down
    at_upper = movable & (value >= box.upper) & up
    slides = one_plane & free_aperture & ~jnp.any(held | at_lower | at_upper)
    return Optimum(
        value=value,
        side=side,
        held=held,
        at_lower=at_lower,
        at_upper=at_upper,
        open=jnp.where(slides, _along_one_plane(line, value, box), 0.0),
    )


def _along_one_plane(line: _Line, value: Float[Array, "2"], box: Box) -> Float[Array, "2 2"]:
    """Projection, in parameters over their ranges, onto the direction of E (u - w) = constant."""
    safe = jnp.maximum(value[1], jnp.finfo(value.dtype).tiny)
    along = jnp.stack([-(value[0] - line.share @ line.disparity) / safe, jnp.ones_like(safe)])
    span = box.upper - box.lower
    along = along / jnp.where(span > 0, span, 1.0)
    along = along / jnp.linalg.norm(along)
    return jnp.outer(along, along)


def _candidates(
    line: _Line,
    target: Float[Array, "n"],
    start: Float[Array, "2"],
    nearest: Float[Array, "2"],
    box: Box,
    free_aperture: bool,
    pinhole: Bool[Array, ""],
) -> Float[Array, "m 2"]:
    """Feasible values, of which the best is the optimum for `target`.

    The first keeps the aperture, the next have the radii that are `nearest` to it on one plane.
    """

    def at_radius(radius: Float[Array, ""]) -> Float[Array, "2"]:
        focus = jnp.where(pinhole, start[0], line.focus(jnp.where(pinhole, 1.0, radius), target))
        return jnp.stack([jnp.clip(focus, box.lower[0], box.upper[0]), radius])

    def at_focus(focus: Float[Array, ""]) -> Float[Array, "2"]:
        radius = line.radius(focus, target, start[1])
        return jnp.stack([focus, jnp.clip(radius, box.lower[1], box.upper[1])])

    if not free_aperture:
        return at_radius(start[1])[None]
    inside = jnp.clip(line.both(target, start[1]), box.lower[1], box.upper[1])
    radii = jnp.stack([start[1], *nearest, inside, box.lower[1], box.upper[1]])
    foci = jnp.stack([box.lower[0], box.upper[0]])
    return jnp.concatenate([jax.vmap(at_radius)(radii), jax.vmap(at_focus)(foci)])


def _nearest_radius(
    line: _Line,
    target: Float[Array, "n"],
    start: Float[Array, "2"],
    scale: Float[Array, "2"],
    box: Box,
) -> Float[Array, ""]:
    """Of all pairs that make the best of one plane, the aperture radius of the one nearest to the start.

    The blur of a plane at w is to be t = k E (u - w), so that u follows from E; the root of the slope of the
    squared distance in E is bracketed among steps of equal ratio, and halved.
    """
    wished = line.share @ target / line.slope
    plane = line.share @ line.disparity

    def slope(radius: Float[Array, ""]) -> Float[Array, ""]:
        focus = plane + wished / radius
        by_focus = -(scale[0] ** 2) * (focus - start[0]) * wished / radius**2
        return by_focus + scale[1] ** 2 * (radius - start[1])

    def distance(radius: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.linalg.norm(scale * (jnp.stack([plane + wished / radius, radius]) - start))

    steps = jnp.linspace(0.0, 1.0, _RADII, dtype=start.dtype)
    least = jnp.maximum(box.lower[1], jnp.finfo(start.dtype).tiny)
    radii = least * (jnp.maximum(box.upper[1], least) / least) ** steps
    at = jnp.argmin(jax.vmap(distance)(radii))
    low, high = radii[jnp.maximum(at - 1, 0)], radii[jnp.minimum(at + 1, _RADII - 1)]

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        rising = slope(middle) > 0
        return jnp.where(rising, low, middle), jnp.where(rising, middle, high)

    low, high = jax.lax.fori_loop(0, jnp.finfo(start.dtype).nmant, halve, (low, high))
    return 0.5 * (low + high)


def nearest_of(
    equal: Bool[Array, " s"], change: Float[Array, " s"], focus: Float[Array, " s"]
) -> Int[Array, ""]:
    """Of solutions that are `equal` the one of least `change`, and of such the one of nearest focus.

    Changes in pixels that are within 1 % of one another are the same.
    """
    least = jnp.min(jnp.where(equal, change, jnp.inf))
    return jnp.argmax(jnp.where(equal & (change <= 1.01 * least + UNDETERMINED_PX), focus, -jnp.inf))


def _pushed(
    line: _Line, value: Float[Array, "2"], target: Float[Array, "n"]
) -> tuple[Bool[Array, "2"], Bool[Array, "2"]]:
    """Which parameters the wishes would lower, and which raise: the slope of the cost beyond rounding."""
    miss, noise = line.misses(value, target)
    per_focus = jnp.full_like(miss, line.slope * value[1])
    per_radius = line.slope * (value[0] - line.disparity)
    jacobian = jnp.stack([per_focus, per_radius])
    gradient = jacobian @ (line.share * miss)
    rounding = jnp.abs(jacobian) @ (line.share * noise)
    return gradient > rounding, gradient < -rounding


def _ratio(
    numerator: Float[Array, ""], denominator: Float[Array, ""], otherwise: Float[Array, ""]
) -> Float[Array, ""]:
    """Quotient, or `otherwise` where the denominator is 0."""
    defined = denominator != 0.0
    return jnp.where(defined, numerator / jnp.where(defined, denominator, 1.0), otherwise)
