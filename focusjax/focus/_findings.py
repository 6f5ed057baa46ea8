"""What wishes cost each other, for pictures and shots alike: a picture is a shot of one frame."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from focusjax._device import device_array
from focusjax._words import listed
from focusjax.focus._bounds import Limits
from focusjax.focus._frames_solution import FramesSolution
from focusjax.focus._image_points import ACROSS, BLUR, ImagePoints
from focusjax.focus._solution import Solution

NOTABLE_PX = 0.05
"""Errors and gains below this are not worth a word."""

_MOST_SAID = 6
"""Conflicts that are put into words, worst first; the others are only counted."""

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
_PARAMETERS = {"f_number": "f-number", "focal_length": "focal length"}

Errors = Float[np.ndarray, "t m"]
"""Largest error in pixels of each wish in each frame."""

Stretches = tuple[tuple[int, int], ...]
"""First and last frame, from 1, of every stretch of frames."""


@dataclasses.dataclass(frozen=True)
class Conflict:
    """Two wishes of which at least one would be met better without the other.

    Attributes:
        first: a wish's name.
        second: another's.
        first_gains: pixels by which the first would be met better if the second were dropped; negative when
            it would be met worse.
        second_gains: the same for the second if the first were dropped.
        frames: of a shot, the first and last frames of each stretch in which one of them gains, counted
            from 1; empty for one picture.
    """

    first: str
    second: str
    first_gains: float
    second_gains: float
    frames: Stretches = ()

    @property
    def mutual(self) -> bool:
        """Whether both would gain, and not one alone."""
        return min(self.first_gains, self.second_gains) >= NOTABLE_PX


@dataclasses.dataclass(frozen=True)
class Unreachable:
    """A wish that no allowed setting meets, even if it were the only one.

    Attributes:
        name: of the wish.
        best: its error in pixels when nothing else counts; in a shot, the largest of all frames.
        frames: of a shot, as for `Conflict`.
    """

    name: str
    best: float
    frames: Stretches = ()


@dataclasses.dataclass(frozen=True)
class Verdict:
    """How well each wish is met, in every frame.

    Attributes:
        names: of the wishes.
        error: largest error in pixels.
        tolerance: in pixels.
        judged: frames in which the wish counts.
        over_time: whether it is of a shot, so that findings say in which frames.
    """

    names: tuple[str, ...]
    error: Errors
    tolerance: Errors
    judged: Bool[np.ndarray, "t m"]
    over_time: bool

    @property
    def missed(self) -> Bool[np.ndarray, "t m"]:
        """Frames in which the wish counts and is off by more than its tolerance."""
        return self.judged & (self.error > self.tolerance)

    def unmet(self) -> list[int]:
        """Wishes that are missed in some frame."""
        return [int(index) for index in np.flatnonzero(self.missed.any(axis=0))]

    @property
    def notable(self) -> bool:
        """Whether any wish is off by enough to look for what it conflicts with."""
        return bool((self.judged & (self.error >= NOTABLE_PX)).any())

    def stretches(self, which: Bool[np.ndarray, "t"]) -> Stretches:
        """The frames of a shot in stretches; none of one picture."""
        return runs(which) if self.over_time else ()


def verdict_of(
    points: ImagePoints, error: Float[np.ndarray, "*t n"], counts: Bool[np.ndarray, "t m"] | None = None
) -> Verdict:
    """How the wishes of a picture, or of a shot with an axis of frames, are met.

    Args:
        points: rows, with names.
        error: of every row in pixels.
        counts: frames in which each wish is to be judged; all in which it has weight when not given.
    """
    count, wish = len(points.names), np.asarray(points.wish)
    weight, tolerance = (np.atleast_2d(np.asarray(of, float)) for of in (points.weight, points.tolerance))
    has = by_wish(weight, wish, count, weight) > 0
    return Verdict(
        names=points.names,
        error=errors_by_wish(np.atleast_2d(error), points, count, weight),
        tolerance=by_wish(tolerance, wish, count, weight),
        judged=has if counts is None else has & counts,
        over_time=np.ndim(error) > 1,
    )


def reweighted(points: ImagePoints, wish: int, *, alone: bool) -> ImagePoints:
    """The points with one wish `alone`, or without it."""
    weight = np.asarray(points.weight)
    kept = np.where((np.asarray(points.wish) == wish) == alone, weight, 0.0)
    return dataclasses.replace(points, weight=device_array(kept, weight.dtype))


def weightiest(points: ImagePoints, most: int) -> list[int]:
    """Wishes that count, at most so many, in order; points may have an axis of frames."""
    weight, wish = np.asarray(points.weight, dtype=float), np.asarray(points.wish)
    total = np.array([weight[wish == index].sum() for index in range(len(points.names))])
    heaviest = np.argsort(-total, kind="stable")[:most]
    return sorted(int(index) for index in heaviest if total[index] > 0)


def by_wish(
    rows: Float[np.ndarray, "t n"], wish: np.ndarray, count: int, weight: Float[np.ndarray, "t n"]
) -> Errors:
    """The largest value of each wish's rows in each frame; rows without weight only where all are."""
    found = np.zeros((rows.shape[0], count))
    for index in range(count):
        mine = wish == index
        counts = mine & (weight > 0)
        mine = np.where(counts.any(axis=1, keepdims=True), counts, mine)
        found[:, index] = np.max(np.where(mine, rows, 0.0), axis=1)
    return found


def errors_by_wish(
    error: Float[np.ndarray, "t n"], points: ImagePoints, count: int, weight: Float[np.ndarray, "t n"]
) -> Errors:
    """Each wish's error in every frame, measured as `WishResult` does.

    It is the largest of its rows, but of a wish for where a place is shown the distance in the picture.
    """
    size, wish = np.abs(error).astype(float), np.asarray(points.wish)
    if points.quantity is not None:
        placed = np.asarray(points.quantity) != BLUR
        # In many frames the rows are the same, and wishes inside the frame have four of them.
        placed, wish = (each.reshape(-1, each.shape[-1])[0] for each in (placed, wish))
        for index in range(count):
            mine = placed & (wish == index) & (weight > 0).any(axis=0)
            if 0 < mine.sum() < 4:
                size[:, mine] = np.hypot.reduce(size[:, mine], axis=1)[:, None]
    return by_wish(size, np.asarray(points.wish), count, weight)


def find_conflicts(
    verdict: Verdict,
    where: Bool[np.ndarray, "t m"],
    chosen: Sequence[int],
    without: Callable[[int], Errors],
) -> tuple[Conflict, ...]:
    """Pairs of wishes of which one would be met better without the other, worst first.

    Args:
        verdict: how they are met together.
        where: frames in which a gain of each wish matters.
        chosen: wishes to drop, one at a time.
        without: errors when solved without one of them.
    """
    if len(chosen) < 2:
        return ()
    gains = {dropped: verdict.error - without(dropped) for dropped in chosen}

    def gain(of: int, dropped: int) -> float:
        mine = gains[dropped][where[:, of], of]
        return float(mine.max()) if mine.size else 0.0

    found = []
    for position, i in enumerate(chosen):
        for j in chosen[position + 1 :]:
            first, second = gain(i, j), gain(j, i)
            if max(first, second) < NOTABLE_PX:
                continue
            helped = (where[:, i] & (gains[j][:, i] >= NOTABLE_PX)) | (
                where[:, j] & (gains[i][:, j] >= NOTABLE_PX)
            )
            names = verdict.names[i], verdict.names[j]
            found.append(Conflict(*names, first, second, verdict.stretches(helped)))
    return tuple(sorted(found, key=lambda each: -max(each.first_gains, each.second_gains)))


def find_unreachable(verdict: Verdict, alone: Callable[[int], Errors]) -> tuple[Unreachable, ...]:
    """Missed wishes that are missed even when nothing else counts."""
    found = []
    for index in verdict.unmet():
        error = alone(index)[:, index]
        out = verdict.missed[:, index] & (error > verdict.tolerance[:, index])
        if out.any():
            best = float(error[out].max())
            found.append(Unreachable(verdict.names[index], best, verdict.stretches(out)))
    return tuple(found)


def runs(which: Bool[np.ndarray, "t"]) -> Stretches:
    """The stretches of frames that are marked."""
    steps = np.diff(np.concatenate([[0], which.astype(int), [0]]))
    firsts, lasts = np.flatnonzero(steps > 0) + 1, np.flatnonzero(steps < 0)
    return tuple((int(first), int(last)) for first, last in zip(firsts, lasts, strict=True))


def in_frames(stretches: Sequence[tuple[int, int]]) -> str:
    """Stretches of frames in words: " in frames 3 to 9 and 12"; nothing when there are none.

    Example:
        >>> in_frames([(3, 9), (12, 12)]), in_frames([(5, 5)]), in_frames([])
        (' in frames 3 to 9 and 12', ' in frame 5', '')
    """
    if not stretches:
        return ""
    if len(stretches) > 3:
        count = sum(last - first + 1 for first, last in stretches)
        return f" in {count} of the frames {stretches[0][0]} to {stretches[-1][1]}"
    parts = [f"{first}" if first == last else f"{first} to {last}" for first, last in stretches]
    one = len(stretches) == 1 and stretches[0][0] == stretches[0][1]
    return f" in frame{'' if one else 's'} {listed(parts)}"


def conflict_sentences(conflicts: Sequence[Conflict]) -> list[str]:
    """The worst conflicts in words."""
    lines = []
    for each in conflicts[:_MOST_SAID]:
        first, second, when = f'"{each.first}"', f'"{each.second}"', in_frames(each.frames)
        if each.mutual:
            lines.append(
                f"{first} and {second} pull against each other{when}: without {second}, {first} would be met"
                f" {each.first_gains:.2g} px better; without {first}, {second} {each.second_gains:.2g} px."
            )
            continue
        gain, loss = each.second_gains, each.first_gains
        if each.first_gains > each.second_gains:
            first, second, gain, loss = second, first, each.first_gains, each.second_gains
        gives = f"{first} would lose {-loss:.2g} px" if loss <= -NOTABLE_PX else f"{first} would gain nothing"
        lines.append(
            f"{first} costs {second} {gain:.2g} px{when}: without {first}, {second} would be met that much"
            f" better; without {second}, {gives}."
        )
    rest = len(conflicts) - _MOST_SAID
    if rest > 0:
        lines.append(f"{rest} more pair{' pulls' if rest == 1 else 's pull'} against each other, by less.")
    return lines


def unreachable_sentences(unreachable: Sequence[Unreachable]) -> list[str]:
    """Wishes out of reach, in words."""
    return [
        f'"{each.name}" is out of reach even alone{in_frames(each.frames)}:'
        f" the best is {each.best:.3g} px off."
        for each in unreachable
    ]


def framing_sentences(solution: Solution | FramesSolution) -> list[str]:
    """What would let wishes about places in the picture be met, where nothing that is free does."""
    points, free = solution.points, solution.free
    assert solution.asked is not None
    zooms = "focal_length" in free and not solution.asked.plan.keep_view
    if points.quantity is None or zooms:
        return []
    quantity, wish = np.asarray(points.quantity), np.asarray(points.wish)
    weight, tolerance = np.asarray(points.weight), np.asarray(points.tolerance)
    off = (quantity != BLUR) & (weight > 0) & (np.abs(np.asarray(solution.error)) > tolerance)
    lines = []
    for index, name in enumerate(points.names):
        mine = off & (wish == index)
        across, down = (mine & (quantity == ACROSS)).any(), (mine & (quantity != ACROSS)).any()
        wanted = [what for what, is_off in (("shift", across), ("rise", down)) if is_off and what not in free]
        if wanted:
            names = " and ".join(f'"{what}"' for what in wanted)
            lines.append(
                f'"{name}" is not where it is wished, and nothing that is free can move it there: add {names}'
                " to what is free, or move the camera."
            )
    return lines


def bound_sentences(bounds: Mapping[str, Stretches], limits: Limits) -> list[str]:
    """Active bounds by name, each with the frames of a shot in which it is active, in words."""
    lines = []
    for name, stretches in bounds.items():
        # Beyond infinity no lens is focused.
        if name == "max_focus_distance" and np.isinf(limits.far).all():
            lines.append(
                f"The focus is at infinity{in_frames(stretches)}, as far as it goes:"
                " beyond it the wishes could be met better."
            )
            continue
        lines.append(
            f"The {_BOUNDS[name]} stands in the way{in_frames(stretches)}:"
            " beyond it the wishes could be met better."
        )
    return lines


def open_sentence(names: Sequence[str]) -> str:
    """What is left open, and what becomes of it."""
    what = listed([f"the {_PARAMETERS.get(name, name)}" for name in names])
    if len(names) == 1:
        return f"The wishes leave {what} open; it stays as near as it can to where it was."
    return f"The wishes leave {what} open; they stay as near as they can to where they were."
