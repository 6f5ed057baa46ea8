"""What stands between the wishes and a perfect answer, in numbers and in words."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._image_points import ImagePoints
from focusjax.focus._sensitivity import Sensitivity, sensitivity
from focusjax.focus._solution import Asked, Solution, WishResult
from focusjax.focus._solve import solve_asked

NOTABLE_PX = 0.05
"""Errors and gains below this are not worth a word."""

_MOST_WISHES = 16
"""Every wish is dropped once to see what the others gain; of more than this, the weightiest."""

_BOUNDS = {
    "min_focus_distance": "closest focus distance",
    "max_focus_distance": "farthest focus distance",
    "min_f_number": "widest aperture",
    "max_f_number": "smallest aperture",
    "min_tilt": "least tilt",
    "max_tilt": "largest tilt",
    "min_swing": "least swing",
    "max_swing": "largest swing",
    "min_focal_length": "shortest focal length",
    "max_focal_length": "longest focal length",
    "min_shift": "least shift",
    "max_shift": "largest shift",
    "min_rise": "least rise",
    "max_rise": "largest rise",
}


@dataclasses.dataclass(frozen=True)
class Conflict:
    """Two wishes that cannot both be had in full.

    Attributes:
        first: a wish's name.
        second: another's.
        first_gains: pixels by which the first would be met better if the second were dropped.
        second_gains: pixels by which the second would be met better if the first were dropped.
    """

    first: str
    second: str
    first_gains: float
    second_gains: float


@dataclasses.dataclass(frozen=True)
class Unreachable:
    """A wish that no allowed setting meets, even if it were the only one.

    Attributes:
        name: of the wish.
        best: its error in pixels when nothing else counts.
    """

    name: str
    best: float


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """How well the wishes determine the solution, and what keeps it from being better.

    Attributes:
        singular_values: for each principal direction of the parameters, the change of all blurs together
            (root of the sum of squares, in pixels) over the whole allowed range; largest first.
        directions: for each of them, what part each parameter has in it, in shares of the ranges.
        open_directions: those of the directions that change no blur by as much as `UNDETERMINED_PX`.
        standard_errors: for each parameter, by how much it would change if the wishes' blurs were
            uncertain by their tolerances, one by one: in dioptres for the focus, in f-numbers, radians and
            metres for the others; infinite for what is open and 0 for what is at a bound.
        conflicts: pairs of wishes that pull against each other, worst first.
        unreachable: wishes that cannot be met at all.
        active_bounds: bounds that keep a parameter from a better value.
        sentences: all of that in words.
    """

    singular_values: tuple[float, ...]
    directions: tuple[dict[str, float], ...]
    open_directions: tuple[dict[str, float], ...]
    standard_errors: dict[str, float]
    conflicts: tuple[Conflict, ...]
    unreachable: tuple[Unreachable, ...]
    active_bounds: tuple[str, ...]
    sentences: tuple[str, ...]


def diagnose(solution: Solution) -> Diagnosis:
    """The diagnosis of one solution, as `solve` returned it.

    Solves again without each wish, and for each missed wish alone; that compiles nothing new.

    Args:
        solution: known values, not traced ones.

    Raises:
        ValueError: a solution from `solve_many`, which does not know its problem.

    Example:
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate, solve
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> wishes = [FocusPoint(AtPoint((0, 0, -z)), Sharp(), name=f"{z} m") for z in (2, 4)]
        >>> diagnosis = diagnose(solve(locate(wishes, camera), camera, start))
        >>> [(c.first, c.second, round(c.first_gains, 2)) for c in diagnosis.conflicts]
        [('2 m', '4 m', 2.78)]
    """
    if solution.asked is None:
        raise ValueError("the solution is one of many; solve it by itself to diagnose it")
    table = solution.table()
    sensed = sensitivity(solution, solution.asked)
    conflicts = _conflicts(solution.asked, table)
    unreachable = _unreachable(solution.asked, table)
    weak = sensed.singular_values < UNDETERMINED_PX
    directions = tuple(dict(zip(sensed.names, map(float, row), strict=True)) for row in sensed.directions)
    return Diagnosis(
        singular_values=tuple(map(float, sensed.singular_values)),
        directions=directions,
        open_directions=tuple(each for each, is_weak in zip(directions, weak, strict=True) if is_weak),
        standard_errors=sensed.standard_errors,
        conflicts=conflicts,
        unreachable=unreachable,
        active_bounds=solution.active_bounds,
        sentences=(
            *_missed_sentences(table, unreachable),
            *_conflict_sentences(conflicts),
            *(
                f"The {_BOUNDS[bound]} stands in the way: beyond it the wishes could be met better."
                for bound in solution.active_bounds
            ),
            *_open_sentences(solution, sensed),
            *(f"{row.name} is {row.note} and does not count." for row in table if not row.counts),
        ),
    )


def _conflicts(asked: Asked, table: tuple[WishResult, ...]) -> tuple[Conflict, ...]:
    """Pairs of wishes of which each would be met better without the other."""
    weights = np.array([row.weight for row in table])
    if max(abs(row.residual) for row in table) < NOTABLE_PX or np.sum(weights > 0) < 2:
        return ()
    heaviest = np.argsort(-weights, kind="stable")[:_MOST_WISHES]
    chosen = sorted(int(index) for index in heaviest if weights[index] > 0)
    now = np.array([abs(row.residual) for row in table])
    gains = {}
    for dropped in chosen:
        rest = np.where(np.asarray(asked.points.wish) == dropped, 0.0, np.asarray(asked.points.weight))
        gains[dropped] = now - _worst_errors(asked, rest)
    found = [
        Conflict(table[i].name, table[j].name, float(gains[j][i]), float(gains[i][j]))
        for i in chosen
        for j in chosen
        if i < j and min(gains[j][i], gains[i][j]) >= NOTABLE_PX
    ]
    return tuple(sorted(found, key=lambda each: -each.first_gains - each.second_gains))


def _unreachable(asked: Asked, table: tuple[WishResult, ...]) -> tuple[Unreachable, ...]:
    """Missed wishes that are missed even when nothing else counts."""
    found = []
    for index, row in enumerate(table):
        if row.met or not row.weight > 0:
            continue
        mine = np.asarray(asked.points.wish) == index
        best = float(_worst_errors(asked, np.where(mine, np.asarray(asked.points.weight), 0.0))[index])
        if best > row.tolerance:
            found.append(Unreachable(row.name, best))
    return tuple(found)


def _worst_errors(asked: Asked, weight: Float[np.ndarray, "n"]) -> Float[np.ndarray, "m"]:
    """The largest error in pixels of every wish, when solved with other weights."""
    points: ImagePoints = asked.points
    changed = dataclasses.replace(points, weight=jnp.asarray(weight, dtype=points.weight.dtype))
    solution, _ = solve_asked(dataclasses.replace(asked, points=changed))
    error, wish = np.abs(np.asarray(solution.error)), np.asarray(points.wish)
    return np.array([error[wish == index].max() for index in range(len(points.names))])


def _missed_sentences(table: tuple[WishResult, ...], unreachable: tuple[Unreachable, ...]) -> list[str]:
    missed = [row for row in table if row.counts and not row.met]
    if not missed:
        return []
    worst = max(missed, key=lambda row: abs(row.residual))
    lines = [
        f"Not all wishes can be met: the best is {abs(worst.residual):.3g} px off at {worst.name}."
        if len(table) > 1
        else f"{worst.name} cannot be met: the best is {abs(worst.residual):.3g} px off."
    ]
    if len(table) > 1:
        lines += [
            f"{each.name} is out of reach even alone: the best is {each.best:.3g} px off."
            for each in unreachable
        ]
    return lines


def _conflict_sentences(conflicts: tuple[Conflict, ...]) -> list[str]:
    return [
        f"{each.first} and {each.second} pull against each other: without {each.second},"
        f" {each.first} would be met {each.first_gains:.2g} px better; without {each.first},"
        f" {each.second} {each.second_gains:.2g} px."
        for each in conflicts
    ]


def _open_sentences(solution: Solution, sensed: Sensitivity) -> list[str]:
    """What the wishes leave open, and the geometry that leaves it so where that is known."""
    lines, left = [], list(solution.undetermined)
    turning = [name for name in left if name in ("tilt", "swing")]
    if turning and sensed.points_in_line:
        what = " and ".join(turning)
        lines.append(
            "These points are on a line in the picture, or fewer than two:"
            if sensed.line is None
            else f"The points lie on one line in the picture, {sensed.line:.0f} degrees from level:"
        )
        lines[-1] += f" the {what} that turns the plane in focus about it is undetermined."
        left = [name for name in left if name not in ("tilt", "swing", "focus")]
    if left == ["f_number"] and sensed.one_depth:
        lines.append("All wishes are at one distance, so that any f-number will do; it stays as it was.")
    elif left:
        what = " and ".join(left).replace("_", "-")
        lines.append(f"The wishes leave {what} open; it stays as near as it can to where it was.")
    return lines
