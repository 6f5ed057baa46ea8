"""What stands between wishes and the focal surface that meets them best."""

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax._arguments import ArgumentError
from focusjax._words import listed
from focusjax.focus._diagnose_picture import idle_sentences, missed_sentences
from focusjax.focus._findings import (
    NOTABLE_PX,
    Conflict,
    Errors,
    Unreachable,
    conflict_sentences,
    find_conflicts,
    find_unreachable,
    reweighted,
    verdict_of,
    weightiest,
)
from focusjax.focus._global import UNDETERMINED_PX
from focusjax.focus._solve_surface import SurfaceAsked, SurfaceSolution, surface_errors

_MOST_WISHES = 16
"""As for a lens: of more wishes than this, the weightiest are dropped once."""

_RANGE_PX = 10.0
"""Change of blur at a control point that stands for its range, as its value has no bounds."""


@dataclasses.dataclass(frozen=True)
class SurfaceDiagnosis:
    """How well the wishes determine a focal surface, and what keeps it from meeting them.

    Attributes:
        singular_values: for each principal direction of the control values, the change of all wishes' blurs
            together in pixels while the blur at the control points changes by 1 px; largest first.
        open_controls: control points, counted from 0, that the wishes leave to smoothness, or where there is
            none, to the surface given.
        conflicts: as of a `Diagnosis`.
        unreachable: as of a `Diagnosis`.
        smoothness_costs: for each wish, pixels by which it would be met better without smoothness.
        beyond_infinity: control points, counted from 0, whose focal disparity came out negative.
        sentences: all of that in words.
    """

    singular_values: tuple[float, ...]
    open_controls: tuple[int, ...]
    conflicts: tuple[Conflict, ...]
    unreachable: tuple[Unreachable, ...]
    smoothness_costs: dict[str, float]
    beyond_infinity: tuple[int, ...]
    sentences: tuple[str, ...]


def diagnose_surface(solution: SurfaceSolution, controls: Sequence[str] = ()) -> SurfaceDiagnosis:
    """The diagnosis of a focal surface; see `diagnose`."""
    asked = solution.asked
    assert asked is not None
    count = len(solution.surface.focus_disparity)
    if len(controls) not in (0, count):
        raise ArgumentError(
            f"there are {len(controls)} names of control points; expected {count}, or none", "controls"
        )
    table, verdict = solution.table(), verdict_of(asked.points, np.asarray(solution.error))

    def errors(wish: int, *, alone: bool) -> Errors:
        return _errors(dataclasses.replace(asked, points=reweighted(asked.points, wish, alone=alone)))

    conflicts: tuple[Conflict, ...] = ()
    costs = dict.fromkeys(asked.points.names, 0.0)
    if verdict.notable:
        chosen = weightiest(asked.points, _MOST_WISHES)
        conflicts = find_conflicts(verdict, verdict.judged, chosen, partial(errors, alone=False))
        free = _errors(dataclasses.replace(asked, smoothness=jnp.zeros_like(asked.smoothness)))
        costs = {
            name: float(cost) if judged else 0.0
            for name, cost, judged in zip(
                verdict.names, (verdict.error - free)[0], verdict.judged[0], strict=True
            )
        }
    unreachable = find_unreachable(verdict, partial(errors, alone=True))
    values, open_controls = _shares(solution)
    beyond = tuple(int(k) for k in np.flatnonzero(np.asarray(solution.surface.focus_disparity) < 0))
    return SurfaceDiagnosis(
        singular_values=tuple(map(float, values)),
        open_controls=open_controls,
        conflicts=conflicts,
        unreachable=unreachable,
        smoothness_costs=costs,
        beyond_infinity=beyond,
        sentences=(
            *missed_sentences(table, unreachable),
            *conflict_sentences(conflicts),
            *_smoothness_sentences(costs),
            *_open_sentences(_in_words(open_controls, controls), float(asked.smoothness)),
            *_beyond_sentences(_in_words(beyond, controls)),
            *idle_sentences(table),
        ),
    )


def _errors(asked: SurfaceAsked) -> Errors:
    return verdict_of(asked.points, np.asarray(surface_errors(asked))).error


def _shares(solution: SurfaceSolution) -> tuple[Float[np.ndarray, "s"], tuple[int, ...]]:
    """Singular values of the blurs' dependence on the control values, and which of these are open."""
    points, surface = solution.points, solution.surface
    counts = np.asarray(points.weight) > 0
    shares = np.asarray(surface.shares(points.xy.T), dtype=float).T[counts]
    _, scale = surface.at(points.xy.T)
    matrix = np.asarray(scale, dtype=float)[counts, None] * shares
    padding = np.zeros((max(0, matrix.shape[1] - matrix.shape[0]), matrix.shape[1]))
    _, values, rows = np.linalg.svd(np.concatenate([matrix, padding]), full_matrices=False)
    weak = rows[values * _RANGE_PX < UNDETERMINED_PX]
    return values, tuple(int(k) for k in np.flatnonzero(np.sum(weak**2, axis=0) > 0.01))


def _smoothness_sentences(costs: dict[str, float]) -> list[str]:
    paid = sorted(((cost, name) for name, cost in costs.items() if cost >= NOTABLE_PX), reverse=True)[:3]
    if not paid:
        return []
    what = listed([f'"{name}" {cost:.2g} px' for cost, name in paid])
    return [f"Smoothness costs {what}: a smaller one lets the surface bend more."]


def _in_words(numbers: tuple[int, ...], names: Sequence[str]) -> str:
    """Some control points in words, by name where they have names; nothing for none of them."""
    if not numbers:
        return ""
    which = [f'"{names[k]}"' if names else str(k) for k in numbers]
    return f"control point{'s' * (len(which) > 1)} {listed(which)}{'' if names else ' (counted from 0)'}"


def _open_sentences(which: str, smoothness: float) -> list[str]:
    if not which:
        return []
    settled = "smoothness alone settles" if smoothness > 0 else "the surface given settles"
    return [f"The wishes leave {which} open, which {settled}."]


def _beyond_sentences(which: str) -> list[str]:
    if not which:
        return []
    return [f"At {which} the surface lies beyond infinity, to give a blur wished there."]
