"""What stands between the wishes of a shot and the lenses that meet them best."""

import dataclasses
from functools import partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from focusjax._words import listed
from focusjax.focus._bounds import LOWER_NAMES, UPPER_NAMES
from focusjax.focus._findings import (
    NOTABLE_PX,
    Conflict,
    Errors,
    Stretches,
    Unreachable,
    Verdict,
    bound_sentences,
    conflict_sentences,
    errors_by_wish,
    find_conflicts,
    find_unreachable,
    framing_sentences,
    in_frames,
    open_sentence,
    reweighted,
    runs,
    unreachable_sentences,
    verdict_of,
    weightiest,
)
from focusjax.focus._frames_asked import FramesAsked
from focusjax.focus._frames_solution import FramesSolution
from focusjax.focus._parameters import PARAMETERS
from focusjax.focus._solve_frames import solve_frames_asked
from focusjax.focus._solve_frames_glass import solve_frames_through
from focusjax.focus._solve_surface_frames import (
    SurfaceFramesAsked,
    SurfaceFramesSolution,
    solve_surface_frames_asked,
)

_MOST_WISHES = 8
"""Every wish is dropped once to see what missed ones gain; of more than this, the weightiest."""


@dataclasses.dataclass(frozen=True)
class MissedWish:
    """A wish that is missed in some frames.

    Attributes:
        name: of the wish.
        frames: first and last of each stretch of frames in which it counts and is missed, from 1.
        worst: its largest error in pixels in these.
        worst_frame: the frame of that, from 1.
        smoothness_costs: pixels by which it would be met better in one of these without smoothness and
            steadiness, which tie each frame to those beside it.
    """

    name: str
    frames: Stretches
    worst: float
    worst_frame: int
    smoothness_costs: float


@dataclasses.dataclass(frozen=True)
class FramesDiagnosis:
    """What keeps the lenses of a shot from meeting its wishes.

    Attributes:
        missed: wishes that are missed by more than their tolerance.
        conflicts: pairs of wishes of which a missed one would be met better without the other, worst first;
            gains are the largest of the frames in which it is missed.
        unreachable: wishes that some frames miss even when nothing else counts in the shot.
        active_bounds: bounds that keep a parameter from a better value, with their stretches of frames.
        open: parameters that the wishes of all frames together leave open.
        idle: wishes that count in no frame.
        sentences: all of that in words.
    """

    missed: tuple[MissedWish, ...]
    conflicts: tuple[Conflict, ...]
    unreachable: tuple[Unreachable, ...]
    active_bounds: dict[str, Stretches]
    open: tuple[str, ...]
    idle: tuple[str, ...]
    sentences: tuple[str, ...]


def diagnose_frames(
    solution: FramesSolution | SurfaceFramesSolution, counts: Bool[np.ndarray, "t m"] | None = None
) -> FramesDiagnosis:
    """The diagnosis of a shot's lenses; see `diagnose`.

    Args:
        solution: as `solve_frames` or `solve_surface_frames` returned it.
        counts: frames in which each wish is to be judged; all in which it has weight when not given.
    """
    asked = solution.asked
    assert asked is not None
    verdict = verdict_of(solution.points, np.asarray(solution.error, dtype=float), counts)
    unmet = verdict.unmet()

    def errors(wish: int, *, alone: bool) -> Errors:
        return _errors(
            solution, dataclasses.replace(asked, points=reweighted(asked.points, wish, alone=alone))
        )

    conflicts: tuple[Conflict, ...] = ()
    free = verdict.error
    if unmet:
        # With nothing to tie them together, the frames are solved each by itself.
        none = jnp.zeros_like(asked.smoothness)
        free = _errors(solution, dataclasses.replace(asked, smoothness=none, steadiness=none))
        chosen = weightiest(solution.points, _MOST_WISHES)
        conflicts = find_conflicts(verdict, verdict.missed, chosen, partial(errors, alone=False))
    unreachable = find_unreachable(verdict, partial(errors, alone=True))
    missed = tuple(_missed(verdict, index, free) for index in unmet)
    lenses = solution if isinstance(solution, FramesSolution) else None
    bounds = {} if lenses is None else _bounds(lenses)
    open_ = () if lenses is None else lenses.undetermined
    counted = np.asarray(verdict.judged).sum(axis=0)
    idle = tuple(name for name, count in zip(asked.names, counted.tolist(), strict=True) if not count)
    return FramesDiagnosis(
        missed=missed,
        conflicts=conflicts,
        unreachable=unreachable,
        active_bounds=bounds,
        open=open_,
        idle=idle,
        sentences=(
            *(_missed_sentence(each) for each in missed),
            *unreachable_sentences(unreachable),
            *([] if lenses is None else framing_sentences(lenses)),
            *conflict_sentences(conflicts),
            *(bound_sentences(bounds, asked.limits) if isinstance(asked, FramesAsked) else []),
            *([open_sentence(open_)] if open_ else []),
            *_idle_sentences(idle),
        ),
    )


def _idle_sentences(idle: tuple[str, ...]) -> list[str]:
    if not idle:
        return []
    names = listed([f'"{name}"' for name in idle])
    return [f"{names} count{'s' if len(idle) == 1 else ''} in no frame."]


def _errors(known: FramesSolution | SurfaceFramesSolution, asked: FramesAsked | SurfaceFramesAsked) -> Errors:
    """Errors by wish, of the rows that have weight in the shot as it was asked first.

    Through glass they are those at nearly the best settings, from those that are `known`.
    """
    if isinstance(asked, SurfaceFramesAsked):
        solution = solve_surface_frames_asked(asked)
    elif asked.glass is None:
        solution = solve_frames_asked(asked)
    else:
        assert isinstance(known, FramesSolution)
        solution = solve_frames_through(asked, near=known)
    assert known.asked is not None
    own = np.asarray(known.asked.points.weight, dtype=float)
    return errors_by_wish(np.asarray(solution.error, dtype=float), asked.points, len(asked.names), own)


def _missed(verdict: Verdict, index: int, free: Errors) -> MissedWish:
    which = verdict.missed[:, index]
    error = np.where(which, verdict.error[:, index], -1.0)
    cost = np.where(which, verdict.error[:, index] - free[:, index], 0.0)
    worst = int(error.argmax())
    return MissedWish(
        verdict.names[index], runs(which), float(error[worst]), worst + 1, float(max(cost.max(), 0.0))
    )


def _missed_sentence(missed: MissedWish) -> str:
    one = len(missed.frames) == 1 and missed.frames[0][0] == missed.frames[0][1]
    at = "" if one else f" (frame {missed.worst_frame})"
    line = f'"{missed.name}" is missed{in_frames(missed.frames)}, by up to {missed.worst:.3g} px{at}'
    if missed.smoothness_costs >= NOTABLE_PX:
        line += f"; smoothness costs it up to {missed.smoothness_costs:.2g} px"
    return line + "."


def _bounds(solution: FramesSolution) -> dict[str, Stretches]:
    """Active bounds by name, and when."""
    found = {}
    for names, active in ((LOWER_NAMES, solution.at_lower), (UPPER_NAMES, solution.at_upper)):
        for column, name in enumerate(solution.free):
            stretches = runs(np.asarray(active)[:, column])
            if stretches:
                found[names[PARAMETERS.index(name)]] = stretches
    return found
