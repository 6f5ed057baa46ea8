"""What stands between the wishes of one picture and a perfect answer, in numbers and in words."""

import dataclasses
from functools import partial

import numpy as np
from jaxtyping import Array, Float

from focusjax.focus._findings import (
    Conflict,
    Errors,
    Unreachable,
    bound_sentences,
    conflict_sentences,
    find_conflicts,
    find_unreachable,
    framing_sentences,
    open_sentence,
    reweighted,
    unreachable_sentences,
    verdict_of,
    weightiest,
)
from focusjax.focus._sensitivity import Sensitivity, sensitivity
from focusjax.focus._solution import PARTLY_OPEN, Asked, Solution, WishResult
from focusjax.focus._solve import solve_asked
from focusjax.focus._solve_glass import solved_again

_MOST_WISHES = 16
"""Every wish is dropped once to see what the others gain; of more than this, the weightiest."""

_EXPLAINED = 1.0 - 1e-4
"""Squared cosine from which on a direction is one of those that are open."""


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


def diagnose_picture(solution: Solution) -> Diagnosis:
    """The diagnosis of one picture's lens; see `diagnose`."""
    asked = solution.asked
    assert asked is not None
    table = solution.table()
    sensed = sensitivity(solution, asked)
    verdict = verdict_of(solution.points, np.asarray(solution.error))
    # From the points with other weights to the errors of their rows.
    solve_again = partial(_errors_again, asked) if asked.glass is None else solved_again(solution)

    def errors(wish: int, *, alone: bool) -> Errors:
        points = reweighted(solution.points, wish, alone=alone)
        return verdict_of(solution.points, np.asarray(solve_again(points.weight))).error

    conflicts: tuple[Conflict, ...] = ()
    if verdict.notable:
        chosen = weightiest(solution.points, _MOST_WISHES)
        conflicts = find_conflicts(verdict, verdict.judged, chosen, partial(errors, alone=False))
    unreachable = find_unreachable(verdict, partial(errors, alone=True))
    directions = tuple(dict(zip(sensed.names, map(float, row), strict=True)) for row in sensed.directions)
    bounds = solution.active_bounds
    return Diagnosis(
        singular_values=tuple(map(float, sensed.singular_values)),
        directions=directions,
        open_directions=directions[len(directions) - len(sensed.open) :],
        standard_errors=sensed.standard_errors,
        conflicts=conflicts,
        unreachable=unreachable,
        active_bounds=bounds,
        sentences=(
            *missed_sentences(table, unreachable),
            *framing_sentences(solution),
            *conflict_sentences(conflicts),
            *bound_sentences(dict.fromkeys(bounds, ()), asked.limits),
            *_open_sentences(sensed),
            *idle_sentences(table),
        ),
    )


def missed_sentences(table: tuple[WishResult, ...], unreachable: tuple[Unreachable, ...]) -> list[str]:
    """Which wishes of one picture are missed, in words."""
    missed = [row for row in table if row.counts and not row.met]
    if not missed:
        return []
    worst = max(missed, key=lambda row: abs(row.residual))
    if len(table) == 1:
        return [f'"{worst.name}" cannot be met: the best is {abs(worst.residual):.3g} px off.']
    return [
        f'Not all wishes can be met: the best is {abs(worst.residual):.3g} px off at "{worst.name}".',
        *unreachable_sentences(unreachable),
    ]


def idle_sentences(table: tuple[WishResult, ...]) -> list[str]:
    """Wishes that have no say though they have a weight, in words."""
    return [f'"{row.name}" is {row.note} and does not count.' for row in table if not row.counts and row.note]


def _errors_again(asked: Asked, weight: Float[Array, "n"]) -> Float[Array, "n"]:
    """Errors of rows in pixels at the best settings for other weights."""
    points = dataclasses.replace(asked.points, weight=weight)
    return solve_asked(dataclasses.replace(asked, points=points))[0].error


def _open_sentences(sensed: Sensitivity) -> list[str]:
    """What the wishes leave open, and the geometry that leaves it so where that is known."""
    lines, rest = [], sensed.open
    if sensed.turn is not None and np.sum((rest @ sensed.turn) ** 2) > _EXPLAINED:
        turning = [
            name
            for name, share in zip(sensed.names, sensed.turn, strict=True)
            if name != "focus" and share**2 > PARTLY_OPEN
        ]
        they = "turn" if len(turning) > 1 else "turns"
        are = "are" if len(turning) > 1 else "is"
        lines.append(
            f"The points lie on one line in the picture, {sensed.line:.0f} degrees from level: the"
            f" {' and '.join(turning)} that {they} the plane in focus about it {are} undetermined."
        )
        # What is open besides turning about that line.
        _, sizes, across = np.linalg.svd(rest - np.outer(rest @ sensed.turn, sensed.turn))
        rest = across[: len(sizes)][sizes > 0.5]
    shares = np.sum(rest**2, axis=0) if len(rest) else np.zeros(len(sensed.names))
    left = [name for name, share in zip(sensed.names, shares, strict=True) if share > PARTLY_OPEN]
    if left == ["f_number"] and sensed.one_depth:
        lines.append("All wishes are at one distance, so that any f-number will do; it stays as it was.")
    elif left:
        lines.append(open_sentence(left))
    return lines
