"""How blur, and where things are shown, depend on the solved parameters, by numpy where no glass is."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._image_points import ACROSS, AT_LEAST, AT_MOST, BLUR, DOWN, SAME
from focusjax.focus._parameters import FOCUS, PARAMETERS, RADIUS, RISE, SHIFT, SWING, TILT, ZOOM
from focusjax.focus._priors import prior_rows
from focusjax.focus._solution import Asked, Solution
from focusjax.focus._solve_glass import defocus_slopes
from focusjax.lens import TiltShiftLens, focus_scale

_AT_LIMIT_PX = 1e-3
"""A limit that is kept with less room than this holds the solution."""

_IN_LINE = 1e-3
"""Spread across a line, in view tangents, below which points are taken to be on it."""


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """See `Diagnosis` for singular values, directions and standard errors.

    Attributes:
        names: free parameters that no bound holds.
        singular_values: pixels over the allowed ranges, largest first.
        directions: principal directions as rows, in shares of the ranges.
        standard_errors: by name of every free parameter.
        open: those of the directions that change nothing by as much as `UNDETERMINED_PX`.
        line: of the line in the picture on which all points that count lie, and those whose blur others are
            to have, the angle from level in degrees, counterclockwise; None when there is no such line.
        one_depth: whether all these points are equally far.
        turn: the direction that turns the plane in focus about that line; None when that is no direction of
            what moves.
    """

    names: tuple[str, ...]
    singular_values: Float[np.ndarray, "m"]
    directions: Float[np.ndarray, "m k"]
    standard_errors: dict[str, float]
    open: Float[np.ndarray, "o k"]
    line: float | None
    one_depth: bool
    turn: Float[np.ndarray, "k"] | None


def sensitivity(solution: Solution, asked: Asked) -> Sensitivity:
    """What the Jacobian of the errors says at the solution of the problem `asked`."""
    columns = [PARAMETERS.index(name) for name in solution.free]
    held = np.asarray(solution.at_lower) | np.asarray(solution.at_upper)
    box = asked.box
    span = (np.asarray(box.upper, dtype=float) - np.asarray(box.lower, dtype=float))[columns]
    moves = ~held & (span > 0)
    jacobian = _slopes(solution, asked)[:, columns]
    counted = np.asarray(solution.points.weight, dtype=float) > 0
    priors = prior_rows(asked.numbers, solution.free, asked.camera)
    inverse = np.asarray(priors.inverse, dtype=float)
    scaled = np.concatenate([jacobian[counted], np.diag(inverse)]) * span
    _, values, rows = np.linalg.svd(scaled[:, moves], full_matrices=False)
    places = _places(solution, counted & ~_framed(solution))
    tangents, depths = _tangents(solution, places[:, :2]), places[:, 2]
    names = tuple(name for name, free in zip(solution.free, moves, strict=True) if free)
    angle = _line(tangents)
    return Sensitivity(
        names=names,
        singular_values=values,
        directions=rows,
        standard_errors=_standard_errors(solution, asked, jacobian, inverse, span, moves),
        open=rows[values < UNDETERMINED_PX],
        line=angle,
        one_depth=len(depths) > 0 and bool(np.ptp(depths) <= 1e-6 * max(depths.max(), 1e-12)),
        turn=None if angle is None else _turn(names, tangents.mean(axis=0), angle, span[moves]),
    )


def _places(solution: Solution, which: Bool[np.ndarray, "n"]) -> Float[np.ndarray, "m 3"]:
    """Position and disparity of the points of some rows, and of those whose blur they are to have."""
    points = solution.points
    own = np.column_stack([np.asarray(points.xy, float), np.asarray(points.disparity, float)])[which]
    if points.reference is None or points.relation is None:
        return own
    same = which & (np.asarray(points.relation) == SAME)
    return np.concatenate([own, np.asarray(points.reference, dtype=float)[same]])


def _turn(
    names: tuple[str, ...], through: Float[np.ndarray, "2"], angle: float, span: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "k"] | None:
    """The change of focus, tilt and swing, in shares of their ranges, that leaves a line's focus alone."""
    right, up = -np.sin(np.radians(angle)), np.cos(np.radians(angle))
    change = {"focus": -(through @ np.array([right, up])), "tilt": up, "swing": right}
    if any(abs(size) > 1e-9 and name not in names for name, size in change.items()):
        return None
    direction = np.array([change.get(name, 0.0) for name in names]) / span
    return direction / np.linalg.norm(direction)


def _framed(solution: Solution) -> Bool[np.ndarray, "n"]:
    """Rows about where something is shown."""
    points = solution.points
    if points.quantity is None:
        return np.zeros(points.wish.shape, dtype=bool)
    return np.asarray(points.quantity) != BLUR


def _tangents(solution: Solution, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Right and up per metre ahead."""
    camera = solution.camera
    middle = np.asarray(camera.principal_point, dtype=float)
    return (xy - middle) / float(camera.focal_px) * np.array([1.0, -1.0])


def _slopes(solution: Solution, asked: Asked) -> Float[np.ndarray, "n 7"]:
    """Change of every error in pixels with every parameter, in the units of the solve's vector."""
    points = solution.points
    own = _blur_slopes(solution, asked, np.asarray(points.xy, float), np.asarray(points.disparity, float))
    signed, blur = np.asarray(points.signed), np.asarray(solution.blur)
    if points.quantity is not None:
        quantity, xy = np.asarray(points.quantity), np.asarray(points.xy, dtype=float)
        blur = np.where(quantity == BLUR, blur, np.where(quantity == ACROSS, *xy.T))
        own = np.where((quantity == BLUR)[:, None], own, _place_slopes(solution, asked, quantity, xy))
    side = np.where(signed, 1.0, np.where(blur >= 0, 1.0, -1.0))[:, None]
    slopes = side * own
    if points.relation is None:
        return slopes
    relation = np.asarray(points.relation)
    if points.reference is not None:
        reference = np.asarray(points.reference, dtype=float)
        other = _blur_slopes(solution, asked, reference[:, :2], reference[:, 2])
        other_side = np.where(signed[:, None], 1.0, np.where(other[:, [RADIUS]] >= 0, 1.0, -1.0))
        slopes = slopes - np.where((relation == SAME)[:, None], other_side * other, 0.0)
    room = np.abs(np.where(signed, blur, np.abs(blur)) - np.asarray(points.target)) > _AT_LIMIT_PX
    kept = np.isin(relation, (AT_MOST, AT_LEAST)) & room & (np.asarray(solution.error) == 0)
    return np.where(kept[:, None], 0.0, slopes)


def _blur_slopes(
    solution: Solution, asked: Asked, xy: Float[np.ndarray, "n 2"], disparity: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 7"]:
    """The derivative of the formula in `_parameters`, or through glass, about the solved camera and lens."""
    lens = solution.lens
    tangents = _tangents(solution, xy)
    radius, focus = float(lens.aperture_radius), float(lens.focus_disparity)
    across = np.asarray(lens.plane, dtype=float)[:2] if isinstance(lens, TiltShiftLens) else np.zeros(2)
    zoom = float(solution.camera.focal_length) / float(asked.camera.focal_length)
    gain = 2.0 * float(solution.camera.focal_px)
    defocus = focus + tangents @ across - disparity
    slopes = np.zeros((len(xy), len(PARAMETERS)))
    slopes[:, FOCUS] = gain * radius
    # The vector's radius and plane are those at the starting focal length.
    slopes[:, RADIUS] = gain * zoom * defocus
    slopes[:, TILT] = gain * radius * tangents[:, 1] / zoom
    slopes[:, SWING] = gain * radius * tangents[:, 0] / zoom
    power = 1 if asked.plan.keep_view else 2
    slopes[:, ZOOM] = gain * radius * (power * defocus - tangents @ across) / zoom
    if asked.plan.close_focus != "ignored":
        slopes[:, [FOCUS, RADIUS]] = _close_slopes(solution, asked, disparity)
    if asked.glass is not None:
        place = jnp.asarray(lens.focus_disparity), jnp.asarray(lens.aperture_radius)
        found = defocus_slopes(asked.glass, asked.camera, *place, jnp.asarray(xy), jnp.asarray(disparity))
        slopes[:, [FOCUS, RADIUS]] = found
    return slopes


def _close_slopes(
    solution: Solution, asked: Asked, disparity: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 2"]:
    """The derivative of 2 f E (v (1 + k w) - w) in the setting v of the focus and in E."""
    scale = focus_scale(asked.camera, asked.plan.close_focus)
    setting = np.asarray(scale.setting(solution.lens.focus_disparity), dtype=float)
    stated = float(asked.camera.focal_length) / (2.0 * float(solution.settings().f_number))
    gain, row = 2.0 * float(asked.camera.focal_px), 1.0 + float(scale.offset) * disparity
    return gain * np.column_stack([stated * row, setting * row - disparity])


def _place_slopes(
    solution: Solution, asked: Asked, quantity: Int[np.ndarray, "n"], xy: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 7"]:
    """How places in the picture follow zoom, shift and rise."""
    density = asked.camera.width / float(asked.camera.sensor_width)
    slopes = np.zeros((len(xy), len(PARAMETERS)))
    slopes[:, SHIFT] = np.where(quantity == ACROSS, -density, 0.0)
    slopes[:, RISE] = np.where(quantity == DOWN, density, 0.0)
    if not asked.plan.keep_view:
        zoom = float(solution.camera.focal_length) / float(asked.camera.focal_length)
        away = (xy - np.asarray(solution.camera.principal_point, dtype=float)) / zoom
        slopes[:, ZOOM] = np.where(quantity == ACROSS, *away.T)
    return slopes


def _standard_errors(
    solution: Solution,
    asked: Asked,
    jacobian: Float[np.ndarray, "n k"],
    inverse: Float[np.ndarray, "k"],
    span: Float[np.ndarray, "k"],
    moves: np.ndarray,
) -> dict[str, float]:
    """By how much each parameter follows the wishes' tolerances and the priors' sigmas, root of squares."""
    points, open_ = solution.points, np.asarray(solution.open)
    weight, wish = np.asarray(points.weight, dtype=float), np.asarray(points.wish)
    scaled = jacobian * (span * moves)
    prior = inverse * span * moves
    normal = np.linalg.pinv(scaled.T @ (weight[:, None] * scaled) + np.diag(prior**2), hermitian=True)
    pulls = [
        (weight * np.asarray(points.tolerance, dtype=float) * (wish == index)) @ scaled
        for index in range(len(points.names))
    ]
    changes = np.concatenate([np.stack(pulls), np.diag(prior)]) @ normal * span
    spread = np.where(open_, np.inf, np.sqrt(np.sum(changes**2, axis=0)))
    camera, lens = solution.camera, solution.lens
    length = float(camera.focal_length)
    across = np.asarray(lens.plane, dtype=float)[:2] if isinstance(lens, TiltShiftLens) else np.zeros(2)
    cosines = np.sqrt(np.maximum(1.0 - (length * across) ** 2, 1e-12))
    started = float(asked.camera.focal_length)
    units = {
        "focus": 1.0,
        "f_number": float(lens.f_number(camera)) * length / started / max(float(lens.aperture_radius), 1e-30),
        "tilt": started / cosines[1],
        "swing": started / cosines[0],
        "focal_length": started,
        "shift": 1.0,
        "rise": 1.0,
    }
    if asked.plan.close_focus != "ignored":
        # Of the setting to that of the disparity, and of f / (2 N) to that of N.
        scale = focus_scale(asked.camera, asked.plan.close_focus)
        units["focus"] = float(scale.gain(lens.focus_disparity)) ** 2
        units["f_number"] = 2.0 * float(solution.settings().f_number) ** 2 / started
    return {name: float(spread[index] * units[name]) for index, name in enumerate(solution.free)}


def _line(tangents: Float[np.ndarray, "n 2"]) -> float | None:
    """The angle from level in degrees of the line on which points lie; None when they lie on none or many."""
    if not len(tangents):
        return None
    around = tangents - tangents.mean(axis=0)
    _, spread, axes = np.linalg.svd(np.concatenate([around, np.zeros((2, 2))]), full_matrices=False)
    if spread[0] < _IN_LINE or spread[1] >= _IN_LINE:
        return None
    return float(np.degrees(np.arctan2(axes[0, 1], axes[0, 0]))) % 180.0
