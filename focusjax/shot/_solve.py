"""A shot: what is filmed, by which cameras, and what is wished of it; and the lenses that give it."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.focus import FramesDiagnosis, FramesSolution, diagnose, solve_frames
from focusjax.geometry import Camera
from focusjax.layers import disparity_map
from focusjax.lens import AbstractLens, ThinLens, TiltShiftLens
from focusjax.scene import Scene
from focusjax.shot._motion import MovingScene
from focusjax.shot._wishes import TimedWish, find_wishes

Progress = Callable[[str, float | None], None]
"""Told the stage that runs and, where that is known, the share of it that is done."""


@dataclasses.dataclass(frozen=True)
class Shot:
    """Some frames of a scene.

    Attributes:
        scene: what is filmed.
        cameras: one a frame (see `camera_path`).
        lenses: where to start, and what is not solved for; one a frame.
        wishes: at least one.
        smoothness: see `solve_frames`.
        steadiness: see `solve_frames`.
        fade_frames: see `find_wishes`.
        favour_near: see `find_wishes`.
        options: what is free, bounds and priors, as for `solve`.
        look: from a frame's camera and solved lens to the lens that makes its picture; itself if not given.
        camera_at: the camera between frames, for motion while the shutter is open; without it a camera stands
            still meanwhile.
    """

    scene: MovingScene
    cameras: tuple[Camera, ...]
    lenses: tuple[ThinLens | TiltShiftLens, ...]
    wishes: tuple[TimedWish, ...]
    smoothness: float = 100.0
    steadiness: float = 1.0
    fade_frames: float = 6.0
    favour_near: float = 0.0
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    look: Callable[[Camera, AbstractLens], AbstractLens] | None = None
    camera_at: Callable[[float], Camera] | None = None

    def __post_init__(self) -> None:
        if not self.cameras or len(self.cameras) != len(self.lenses):
            raise ValueError(
                f"the shot has {len(self.cameras)} cameras and {len(self.lenses)} lenses; expected one each"
                " per frame"
            )

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.cameras)


@dataclasses.dataclass(frozen=True)
class SolvedShot:
    """A shot and the lenses found for it.

    Attributes:
        shot: what was asked.
        solution: the lenses of all frames.
        share: part of its weight that each wish has in each frame [t, m], 1 where it counts in full.
        depths: least and largest disparity in 1/m that each frame shows [t, 2]; 0 is the background.
    """

    shot: Shot
    solution: FramesSolution
    share: Float[np.ndarray, "t m"]
    depths: Float[np.ndarray, "t 2"]

    @cached_property
    def diagnosis(self) -> FramesDiagnosis:
        """What keeps the lenses from meeting the wishes, judged where these count in full."""
        return diagnose(self.solution, counts=self.share > 1.0 - 1e-6)

    def missed(self) -> tuple[tuple[str, int, float], ...]:
        """Wishes that are missed by more than their tolerance in some frame in which they count in full.

        Name, number of such frames, and the largest error in pixels.
        """
        worst: dict[str, tuple[int, float]] = {}
        for frame in range(self.solution.count):
            for number, row in enumerate(self.solution.table(frame)):
                if not row.met and row.weight > 0 and self.share[frame, number] > 1.0 - 1e-6:
                    count, error = worst.get(row.name, (0, 0.0))
                    worst[row.name] = (count + 1, max(error, abs(row.residual)))
        return tuple((name, count, error) for name, (count, error) in worst.items())


def solve_shot(
    shot: Shot,
    *,
    throw: bool = True,
    progress: Progress | None = None,
    disparities: Callable[[int], np.ndarray] | None = None,
) -> SolvedShot:
    """The lenses of all frames of a shot, solved together.

    Args:
        shot: what to solve.
        throw: raise an error when the solver fails.
        progress: told how far it is.
        disparities: `disparity_map` of a frame by its number, where these are at hand.

    Raises:
        ValueError: as `find_wishes` and `solve_frames`.
        RuntimeError: the solver failed, and `throw` is true.
    """
    tell: Progress = progress if progress is not None else lambda stage, share: None
    depths: list[tuple[float, float]] = []

    def views() -> Iterator[dict[str, Any]]:
        """What each frame shows; a frame that is as the one before it is not looked at again."""
        known: tuple[Scene, Camera, np.ndarray] | None = None
        for number, camera in enumerate(shot.cameras):
            tell("locate", number / shot.count)
            scene = shot.scene.at(number + 1)
            if disparities is not None:
                known = scene, camera, disparities(number + 1)
            elif known is None or known[0] is not scene or known[1] is not camera:
                known = scene, camera, disparity_map(scene, camera)
            disparity = known[2]
            depths.append((float(disparity.min()), float(disparity.max())))
            yield {
                "vertices": scene.vertices,
                "faces": scene.faces,
                "objects": scene.objects,
                "disparity_map": disparity,
            }

    found = find_wishes(
        shot.wishes, shot.cameras, views(), fade_frames=shot.fade_frames, favour_near=shot.favour_near
    )
    tell("solve", None)
    solution = solve_frames(
        found.points,
        shot.cameras,
        shot.lenses,
        smoothness=shot.smoothness,
        steadiness=shot.steadiness,
        throw=throw,
        **shot.options,
    )
    return SolvedShot(shot, solution, found.share, np.array(depths))
