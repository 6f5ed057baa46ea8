"""Control values of a focal surface from wishes: weighted linear least squares with a smoothness term."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._arguments import ArgumentError, require_kind
from focusjax._programs import jit_in_haste
from focusjax.focus._checks import require_weight
from focusjax.focus._image_points import (
    EQUAL,
    ImagePoints,
    anonymous,
    errors_of,
    filled_up,
    padded,
    repeated,
    room_for,
    root_weight,
)
from focusjax.focus._refuse import checked_points, opened, require_points
from focusjax.focus._solution import AbstractPrinted, WishResult, first_rows, wish_table
from focusjax.geometry import Camera
from focusjax.lens import FocalSurface, FocalSurfaceLens, ThinLens, focal_surface_lens, surface_blur

_GRID = (16, 12)
"""Columns and rows of places in the picture at which roughness is taken."""

_ROUNDS = 8
"""Turns in which unsigned wishes choose sides and the surface follows."""

_STEP_PX = 100.0
"""Distance in the picture over which roughness measures the change of blur."""


class SurfaceAsked(eqx.Module):
    """One problem, its values checked.

    Attributes:
        points: located wishes.
        camera: the pinhole that frames the picture.
        surface: control points, and values to start from.
        lens: aperture radius and shape.
        smoothness: weight of the smoothness term.
    """

    points: ImagePoints
    camera: Camera
    surface: FocalSurface
    lens: ThinLens
    smoothness: Float[Array, ""]


class SurfaceSolution(AbstractPrinted):
    """The solved focal surface, the lens that has it, and how well each wish is met. A pytree.

    Attributes:
        surface: the control points with their solved focal disparities.
        lens: what they make of the starting lens.
        points: what was asked.
        blur: signed blur diameter in pixels at every point.
        error: difference from the wish in pixels at every point, as `errors` defines it.
        roughness: root mean square over the picture of the change of blur in px per 100 px, for something
            at one depth.
        cost: half the sum of weight x error^2 plus smoothness x roughness^2, in px^2.
        asked: the problem.
    """

    surface: FocalSurface
    lens: FocalSurfaceLens
    points: ImagePoints
    blur: Float[Array, "n"]
    error: Float[Array, "n"]
    roughness: Float[Array, ""]
    cost: Float[Array, ""]
    asked: SurfaceAsked | None = None

    def table(self) -> tuple[WishResult, ...]:
        """One line per wish, in the order they were given."""
        return wish_table(self.points, self.blur, self.error)


def solve_focal_surface(
    points: ImagePoints,
    camera: Camera,
    surface: FocalSurface,
    lens: ThinLens,
    *,
    smoothness: ArrayLike = 1e-3,
) -> SurfaceSolution:
    """The focal disparities of control points that meet the wishes best, all at once.

    With u_i the control values and phi_i(x) their shares of the surface at x, the blur at a point is
    2 f E s(x) (sum_i phi_i(x) u_i - w): linear in u. Minimised is

        sum of weight x (error in px)^2 + smoothness x roughness^2,

    where roughness is the root mean square over the picture of |gradient of 2 f E w_f| in px per 100 px. So
    a blur that changes by 1 px per 100 px all over the picture costs as much as a wish of weight
    `smoothness` that is missed by 1 px. What neither determines stays as near as can be to the surface given.

    Unsigned wishes take sides by turns with the solve, from four starts: all behind the focus, all in front,
    each as the surface given has it, and near half in front. Signed and sharp wishes make the problem
    linear, with one solve. Focal disparities are not bounded: below 0 they lie beyond infinity.

    The solution is differentiable in the wishes, the camera, the lens and the surface's positions, weights,
    kernel and aperture scale; the sides are held.

    Args:
        points: located wishes to be sharp or blurred; at least one has positive weight.
        camera: the pinhole that frames the picture.
        surface: control points, and values to start from.
        lens: aperture radius and shape; its focus is not used.
        smoothness: weight of the smoothness term; 0 or more.

    Raises:
        ValueError: an argument out of range, a pinhole, no point with positive weight, or a wish for a
            limit (`AtMost`, `AtLeast`) or for another point's blur, which are not linear.

    Example:
        >>> from focusjax.focus import AtPixel, FocusPoint, Sharp, locate
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import focal_surface, thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> wishes = [FocusPoint(AtPixel(12.5, 20.5), Sharp()), FocusPoint(AtPixel(50.5, 20.5), Sharp())]
        >>> depth = jnp.broadcast_to(jnp.linspace(0.4, 0.8, 64), (48, 64))
        >>> points = locate(wishes, camera, disparity_map=depth)
        >>> thin = thin_lens(focus_distance=2.0, f_number=4.0, focal_length=0.05)
        >>> found = solve_focal_surface(points, camera, focal_surface(points.xy, 0.5), thin)
        >>> bool(jnp.abs(found.error).max() < 0.01)
        True
    """
    usage = "solve_focal_surface(points, camera, surface, lens)"
    require_points(points, usage, axes=1)
    require_kind(camera, Camera, usage, "`look_at` and `make_camera` make one", "camera")
    require_kind(surface, FocalSurface, usage, "`focal_surface` makes one", "surface")
    require_kind(lens, ThinLens, usage, "`thin_lens` makes one", "lens")
    points = without_relations(checked_points(points))
    smoothness = require_weight("smoothness", smoothness)
    asked = SurfaceAsked(points, camera, surface, opened(lens), smoothness)
    solved, blur, error, roughness, cost = _solved(asked)
    made = focal_surface_lens(solved, camera, asked.lens)
    return SurfaceSolution(solved, made, points, blur, error, roughness, cost, asked)


def surface_errors(asked: SurfaceAsked) -> Float[Array, "n"]:
    """The errors of a checked problem's solution, without the lens, which is as large as the picture."""
    return _solved(asked)[2]


def _solved(asked: SurfaceAsked) -> tuple[FocalSurface, Array, Array, Array, Array]:
    """The surface, blur and error of every wish, roughness, and cost.

    Rows without weight fill the problem up, so that few sizes are compiled.
    """
    points, controls = asked.points, asked.surface
    wishes, count = points.weight.shape[0], controls.weight.shape[0]
    focus, blur, error, roughness, cost = _solve(
        anonymous(padded(points, room_for(wishes))),
        asked.camera,
        _with_controls(controls, room_for(count)),
        asked.lens,
        asked.smoothness,
    )
    surface = dataclasses.replace(controls, focus_disparity=first_rows(focus, count))
    return surface, first_rows(blur, wishes), first_rows(error, wishes), roughness, cost


def _with_controls(surface: FocalSurface, size: int) -> FocalSurface:
    """The surface with its last control point repeated, without weight, up to `size`."""
    longest = {
        name: repeated(getattr(surface, name), size) for name in ("xy", "focus_disparity", "aperture_scale")
    }
    return dataclasses.replace(surface, **longest, weight=filled_up(surface.weight, size))


def without_relations(points: ImagePoints) -> ImagePoints:
    """The points without relations, when each wishes a blur of its own."""
    if points.quantity is not None:
        raise ArgumentError(
            "a wish is for a place in the picture, which a focal surface does not change; remove it", "points"
        )
    if points.relation is None:
        return points
    others = points.relation != EQUAL
    message = "a wish is a limit, or for the blur of another point; a focal surface takes sharpness and blurs"
    if isinstance(others, Tracer):
        points = eqx.error_if(points, jnp.any(others), message)
    elif np.any(others):
        raise ArgumentError(message, "points")
    return dataclasses.replace(points, relation=None, reference=None)


class LinearSurface(eqx.Module):
    """Residuals of wishes and smoothness as functions of the change of control values.

    The change is in px of blur, 2 f E times the change of disparity.

    Attributes:
        matrix: of the residuals of the wishes, then of the smoothness term.
        behind: the residuals without change, for wished blurs of 0.
        target: sqrt(weight) x wished blur; unsigned ones behind the focus.
    """

    matrix: Float[Array, "r k"]
    behind: Float[Array, "r"]
    target: Float[Array, "n"]

    def right(self, side: Float[Array, "n"]) -> Float[Array, "r"]:
        """What the matrix times the change is to be, when unsigned wishes have chosen a `side`."""
        wished = jnp.pad(side * self.target, (0, self.behind.size - side.size))
        return wished - self.behind

    def change(self, side: Float[Array, "n"]) -> Float[Array, "k"]:
        """The best change; the smallest, where several are as good."""
        import lineax as lx

        return lx.linear_solve(lx.MatrixLinearOperator(self.matrix), self.right(side), lx.SVD()).value


@jit_in_haste
def _solve(
    points: ImagePoints, camera: Camera, surface: FocalSurface, lens: ThinLens, smoothness: Float[Array, ""]
) -> tuple[Array, ...]:
    """Focal disparities of all control points, blur and error of all wishes, roughness, and cost."""
    slope = 2.0 * camera.focal_px * lens.aperture_radius
    linear = linear_surface(points, camera, surface, slope, smoothness)
    side = jax.lax.stop_gradient(_sides(jax.lax.stop_gradient(linear), points))
    change = linear.change(side)
    solved = dataclasses.replace(surface, focus_disparity=surface.focus_disparity + change / slope)
    blur = surface_blurs(points, camera, solved, lens)
    miss = linear.matrix @ change - linear.right(side)
    rough = miss[points.weight.size :]
    positive = smoothness > 0
    roughness = jnp.sqrt(jnp.where(positive, rough @ rough, 1.0) / jnp.where(positive, smoothness, 1.0))
    error = errors_of(points, blur, None)
    return solved.focus_disparity, blur, error, roughness * positive, 0.5 * miss @ miss


def surface_blurs(
    points: ImagePoints, camera: Camera, surface: FocalSurface, lens: ThinLens
) -> Float[Array, "n"]:
    """Signed blur diameter in pixels at every point, through the lens that the surface makes of `lens`."""
    of_point = jax.vmap(surface_blur, in_axes=(None, None, None, 0, 0))
    return of_point(surface, camera, lens, points.xy, points.disparity)


def linear_surface(
    points: ImagePoints,
    camera: Camera,
    surface: FocalSurface,
    slope: Float[Array, ""],
    smoothness: Float[Array, ""],
) -> LinearSurface:
    """The residuals of wishes and of the smoothness term, which are linear in the control values.

    Changes count from those of `surface`; `slope` is 2 f E, px of blur per 1/m of focal disparity.
    """
    root = root_weight(points.weight)
    shares = surface.shares(points.xy.T).T
    _, scale = surface.at(points.xy.T)
    now = slope * scale * (shares @ surface.focus_disparity - points.disparity)
    columns, rows = _GRID
    x = (jnp.arange(columns) + 0.5) / columns * camera.width
    y = (jnp.arange(rows) + 0.5) / rows * camera.height
    places = jnp.stack([part.reshape(-1) for part in jnp.meshgrid(x, y)], axis=1).astype(surface.xy.dtype)
    gradient = jax.vmap(jax.jacfwd(surface.shares))(places)
    steps = jnp.moveaxis(gradient, 1, 2).reshape(-1, surface.weight.size)
    steps = root_weight(smoothness / len(places)) * _STEP_PX * steps
    return LinearSurface(
        matrix=jnp.concatenate([(root * scale)[:, None] * shares, steps]),
        behind=jnp.concatenate([root * now, slope * steps @ surface.focus_disparity]),
        target=root * points.target,
    )


def starting_sides(linear: LinearSurface, points: ImagePoints) -> Float[Array, "4 n"]:
    """Where the search for sides starts: above 0 behind the focus, below 0 in front of it."""
    count = points.weight.size
    middle = jnp.nanmedian(jnp.where(points.weight > 0, points.disparity, jnp.nan))
    return jnp.stack(
        [
            jnp.ones(count),
            -jnp.ones(count),
            jnp.sign(linear.behind[:count]),
            jnp.where(points.disparity > middle, -1.0, 1.0),
        ]
    ).astype(linear.target.dtype)


def settled_sides(
    start: Float[Array, "*t n"],
    signed: Bool[Array, "*t n"],
    blur: Callable[[Float[Array, "*t n"]], Float[Array, "*t n"]],
) -> Float[Array, "*t n"]:
    """Factors 1 or -1 that make the wished blurs signed ones, where unsigned wishes choose by turns.

    Args:
        start: where the search starts (`starting_sides`).
        signed: wishes that have a side.
        blur: of all points with the best surface for some sides, by any factor above 0.
    """

    def clear(side: Float[Array, "*t n"]) -> Float[Array, "*t n"]:
        return jnp.where(signed | (side >= 0), 1.0, -1.0).astype(start.dtype)

    def turn(_: Array, side: Float[Array, "*t n"]) -> Float[Array, "*t n"]:
        now = blur(side)
        # A point of no weight says nothing, and one on the focus keeps its side.
        return jnp.where(now == 0, side, clear(now))

    return jax.lax.fori_loop(0, _ROUNDS, turn, clear(start))


def _sides(linear: LinearSurface, points: ImagePoints) -> Float[Array, "n"]:
    """The sides that cost least."""

    def blur(side: Float[Array, "n"]) -> Float[Array, "n"]:
        return (linear.matrix @ linear.change(side) + linear.behind)[: side.size]

    def settle(start: Float[Array, "n"]) -> tuple[Float[Array, "n"], Float[Array, ""]]:
        side = settled_sides(start, points.signed, blur)
        miss = linear.matrix @ linear.change(side) - linear.right(side)
        return side, miss @ miss

    sides, costs = jax.vmap(settle)(starting_sides(linear, points))
    return sides[jnp.argmin(costs)]
