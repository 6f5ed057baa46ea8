"""Wishes over time: when they act, how much, and what they wish, without jumps as they come and go."""

import dataclasses
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from focusjax._words import shown
from focusjax.focus import ArgumentError, AtPixel, AtPoint, FocusPoint, ImagePoints, locate
from focusjax.geometry import Camera
from focusjax.motion import Keyframes


@dataclasses.dataclass(frozen=True)
class TimedWish:
    """A wish that acts in some frames, and may change over them.

    Attributes:
        point: the wish as it is where nothing of the following changes it.
        from_frame: first frame in which it acts; the shot's first when None.
        to_frame: last frame in which it acts; the shot's last when None.
        weight: its weight over time, instead of the point's.
        diameter: the wished blur diameter over time, in the unit that the point's wish has.
        place: world position [3] over time of a wish at a point, or pixel [2] of one at a pixel.
    """

    point: FocusPoint
    from_frame: float | None = None
    to_frame: float | None = None
    weight: Keyframes | None = None
    diameter: Keyframes | None = None
    place: Keyframes | None = None

    def __post_init__(self) -> None:
        label = f"wish {self.point.name!r}"
        if None not in (self.from_frame, self.to_frame) and not self.from_frame <= self.to_frame:  # type: ignore[operator]
            raise ValueError(
                f"{label} acts from frame {self.from_frame:g} to frame {self.to_frame:g}; swap the two"
            )
        if self.weight is not None and not np.all(self.weight.values >= 0):
            raise ValueError(f"{label} has a weight of {self.weight.values.min():g}; expected 0 or more")
        if self.diameter is not None and not hasattr(self.point.wish, "diameter"):
            raise ValueError(f"{label} has a blur over time but wishes for no blur; give it a blur to change")
        if self.diameter is not None and not getattr(self.point.wish, "signed", False):
            least = float(self.diameter.values.min())
            if least < 0:
                raise ValueError(f"{label} has a blur of {least:g}; expected 0 or more, or a signed wish")
        if self.place is not None:
            wanted = {AtPoint: 3, AtPixel: 2}.get(type(self.point.where))
            if wanted is None or self.place.values.shape[1:] != (wanted,):
                raise ValueError(
                    f"{label} has places over time; expected the positions [3] of a wish at a point, or the"
                    " pixels [2] of one at a pixel"
                )

    def acts(self, frame: int) -> bool:
        """Whether the wish acts in a frame."""
        after = self.from_frame is None or frame >= self.from_frame
        return after and (self.to_frame is None or frame <= self.to_frame)

    def at(self, frame: int) -> FocusPoint:
        """The wish in one frame; without weight where it does not act."""
        changes: dict[str, Any] = {}
        if self.weight is not None:
            changes["weight"] = float(self.weight(frame))
        if not self.acts(frame):
            changes["weight"] = 0.0
        if self.diameter is not None:
            old = self.point.wish.diameter  # type: ignore[union-attr]
            value = float(self.diameter(frame))
            kind = type(old) if dataclasses.is_dataclass(old) else float
            changes["wish"] = dataclasses.replace(self.point.wish, diameter=kind(value))  # type: ignore[call-arg]
        if self.place is not None:
            place = self.place(frame)
            pixel = isinstance(self.point.where, AtPixel)
            changes["where"] = AtPixel(*map(float, place)) if pixel else AtPoint(place)
        return dataclasses.replace(self.point, **changes)


@dataclasses.dataclass(frozen=True)
class FoundWishes:
    """The wishes of all frames where the cameras see them.

    Attributes:
        points: of every frame, weights faded.
        share: part of its weight that each wish has after fading [t, m]: 1 when it counts in full.
    """

    points: tuple[ImagePoints, ...]
    share: Float[np.ndarray, "t m"]


def find_wishes(
    wishes: Sequence[TimedWish],
    cameras: Sequence[Camera],
    views: Iterable[dict[str, Any]],
    *,
    fade_frames: float = 6.0,
    favour_near: float = 0.0,
    called: str = "wish",
) -> FoundWishes:
    """Where the wishes are in every frame, with weights that come and go gradually.

    A wish counts where it acts, is in the frame and is to be seen (`locate`). Its weight is multiplied by the
    largest share that is nowhere above that and changes by no more than 1 / fade_frames per frame:
    it rises only after the point has appeared and is gone again before it vanishes. What acts in the
    first or the last frame is taken to have acted before or to go on.

    Args:
        wishes: at least one.
        cameras: one a frame.
        views: one a frame: what `locate` needs of the scene (vertices, faces, objects, disparity_map).
        fade_frames: frames from nothing to full weight; 0 lets weights jump.
        favour_near: how much more near wishes count, relative to the nearest of all frames (see `locate`).
        called: what messages call one of them.

    Warns of wishes that count in no frame, or in none in full.

    Raises:
        ArgumentError: as `locate`, with the frame; wishes of which none counts in any frame.
    """
    if not wishes:
        raise ArgumentError("there are no wishes; give at least one", "points")
    require_fade(fade_frames)
    (found,) = located([wishes], cameras, views)
    return counted(wishes, found, fade_frames=fade_frames, favour_near=favour_near, called=called)


LocatedWishes = list[tuple[list[FocusPoint], ImagePoints]]
"""Wishes as they are in each frame, and where they are seen with a weight of 1."""


def require_fade(fade_frames: float) -> None:
    """Refuses what is no number of frames.

    Raises:
        ArgumentError: naming it.
    """
    if not 0 <= fade_frames < np.inf:
        raise ArgumentError(
            f"fade_frames is {shown(fade_frames)}; expected zero or a positive finite number of frames",
            "fade_frames",
        )


def located(
    groups: Sequence[Sequence[TimedWish]], cameras: Sequence[Camera], views: Iterable[dict[str, Any]]
) -> list[LocatedWishes]:
    """Where the wishes of each group are in every frame, from one look at it.

    Args:
        groups: lists of wishes, none of them empty.
        cameras: one a frame.
        views: one a frame, as for `find_wishes`.

    Raises:
        ArgumentError: as `locate`, with the frame.
    """
    found: list[LocatedWishes] = [[] for _ in groups]
    for number, (camera, view) in enumerate(zip(cameras, views, strict=True), start=1):
        for wishes, of_group in zip(groups, found, strict=True):
            points = [wish.at(number) for wish in wishes]
            # The share that is visible is found with a weight of 1, whatever the weight over time is.
            unit = [dataclasses.replace(point, weight=1.0) for point in points]
            try:
                seen = locate(unit, camera, may_be_idle=True, **view)
            except ArgumentError as error:
                raise ArgumentError(f"frame {number}: {error}", error.argument) from None
            of_group.append((points, seen))
    return found


def counted(
    wishes: Sequence[TimedWish], found: LocatedWishes, *, fade_frames: float, favour_near: float, called: str
) -> FoundWishes:
    """The wishes with the weights that they have in every frame, and its warnings; see `find_wishes`.

    Raises:
        ArgumentError: none of them counts in any frame.
    """
    visible = np.array([[_share(seen, m) for m in range(len(wishes))] for _, seen in found])
    acting = np.array([[wish.acts(t + 1) for wish in wishes] for t in range(len(found))])
    share = faded(np.where(acting, visible, 0.0), fade_frames)
    nearest = max(
        float(np.max(np.asarray(seen.disparity) * (np.asarray(seen.weight) > 0))) for _, seen in found
    )
    out = []
    for t, (points, seen) in enumerate(found):
        wish, disparity = np.asarray(seen.wish), np.asarray(seen.disparity)
        factor = np.array([float(point.weight) for point in points]) * share[t]
        factor = factor / np.where(visible[t] > 0, visible[t], 1.0)
        near = 1.0 + favour_near * disparity / max(nearest, np.finfo(float).tiny)
        weight = np.asarray(seen.weight) * factor[wish] * near
        out.append(dataclasses.replace(seen, weight=jnp.asarray(weight, dtype=float)))
    _warn_of_idle(wishes, found, acting, visible, share, called)
    return FoundWishes(tuple(out), share)


def _warn_of_idle(
    wishes: Sequence[TimedWish],
    found: LocatedWishes,
    acting: Bool[np.ndarray, "t m"],
    visible: Float[np.ndarray, "t m"],
    share: Float[np.ndarray, "t m"],
    called: str,
) -> None:
    """Warns of wishes that have a weight and never count, or never in full.

    Raises:
        ArgumentError: none counts in any frame.
    """
    weight = np.array([[float(point.weight) for point in points] for points, _ in found])
    # A wish that does not act has weight 0 there, so that its own weight decides whether it is wanted.
    wanted = np.array([
        float(wish.point.weight) > 0 if wish.weight is None else bool(wish.weight.values.max() > 0)
        for wish in wishes
    ])  # fmt: skip
    if not (weight * share).any():
        reasons = [
            _idle_reason(wishes[m], [seen.notes[m] for _, seen in found], acting[:, m], called)
            for m in np.flatnonzero(wanted).tolist()
        ]
        raise ArgumentError(
            f"no {called} counts in any frame: " + ("; ".join(reasons) or "give at least one a weight"),
            "points",
        )
    for m in np.flatnonzero(wanted & (share.max(axis=0) < 1.0 - 1e-6)).tolist():
        if not share[:, m].any():
            why = _idle_reason(wishes[m], [seen.notes[m] for _, seen in found], acting[:, m], called)
            warnings.warn(f"{why}, so that it counts in no frame", stacklevel=4)
            continue
        percent = f"{100 * share[:, m].max():.0f} %"
        most = f"{called} {wishes[m].point.name!r} never counts in full ({percent} at most)"
        if np.where(acting[:, m], visible[:, m], 0.0).max() > share[:, m].max() + 1e-6:
            most += ", for it comes and goes too soon to fade in; a smaller fade_frames lets it count sooner"
        else:
            most += ", for it is always hidden in part; move it or the camera, or let it count even_hidden"
        warnings.warn(f"{most}. What counts in part is never called missed", stacklevel=4)


def _idle_reason(wish: TimedWish, notes: Sequence[str], acting: Bool[np.ndarray, "t"], called: str) -> str:
    """Why a wish counts in no frame."""
    name, count = f"{called} {wish.point.name!r}", len(notes)
    if not acting.any():
        ends = [
            f"{word} frame {frame:g}"
            for word, frame in (("from", wish.from_frame), ("to", wish.to_frame))
            if frame is not None
        ]
        return f"{name} acts {' '.join(ends)}, which is none of the shot's frames 1 to {count}"
    reasons = {note for note, acts in zip(notes, acting, strict=True) if acts and note}
    why = " or ".join(sorted(reasons)) or "without weight"
    return f"{name} is {why} in every frame in which it acts"


def faded(share: Float[np.ndarray, "t m"], fade_frames: float) -> Float[np.ndarray, "t m"]:
    """The largest shares nowhere above `share` that change by at most 1 / fade_frames per frame.

    Example:
        >>> faded(np.array([[0.0], [1.0], [1.0], [1.0], [1.0]]), 4.0).ravel().tolist()
        [0.0, 0.25, 0.5, 0.75, 1.0]
    """
    if fade_frames == 0:
        return share
    result = np.array(share)
    for frame in range(1, len(result)):
        result[frame] = np.minimum(result[frame], result[frame - 1] + 1.0 / fade_frames)
    for frame in range(len(result) - 2, -1, -1):
        result[frame] = np.minimum(result[frame], result[frame + 1] + 1.0 / fade_frames)
    return result


def _share(points: ImagePoints, wish: int) -> float:
    """The part of a wish of weight 1 that is to be seen."""
    return float(np.sum(np.asarray(points.weight)[np.asarray(points.wish) == wish]))
