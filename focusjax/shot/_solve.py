"""A shot: what is filmed, by which cameras, and what is wished of it; and the lenses that give it."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.focus import (
    FramesDiagnosis,
    FramesSolution,
    SurfaceFramesSolution,
    diagnose,
    solve_frames,
    solve_surface_frames,
    unsolved,
    unsolved_surfaces,
)
from focusjax.geometry import Camera
from focusjax.job import Progress
from focusjax.layers import disparity_map
from focusjax.lens import AbstractLens, ThinLens, TiltShiftLens
from focusjax.motion import MovingScene
from focusjax.scene import Scene
from focusjax.shot._glass import ShotGlass, solve_through_glass
from focusjax.shot._surfaces import TimedSurface, find_surfaces
from focusjax.shot._wishes import TimedWish, counted, located, require_fade


@dataclasses.dataclass(frozen=True)
class Shot:
    """Some frames of a scene.

    Attributes:
        scene: what is filmed.
        cameras: one a frame (see `camera_path`).
        lenses: where to start, and what is not solved for; one a frame.
        wishes: what is solved for; without any, `lenses` are taken as they are.
        smoothness: see `solve_frames`.
        steadiness: see `solve_frames`.
        fade_frames: see `find_wishes`.
        favour_near: see `find_wishes`.
        options: what is free, bounds, priors and `close_focus`, as for `solve`.
        held: by the names of free settings: frames in which these stay as `lenses` has them, one a frame.
        surface: the control points of a focal surface, of which the focus is solved for instead.
        glass: a real lens that makes the pictures instead of a thin one, and through which wishes are met.
        look: from a frame's number, camera and solved lens to the lens that makes its picture; itself if not
            given.
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
    held: Mapping[str, tuple[bool, ...]] = dataclasses.field(default_factory=dict)
    surface: TimedSurface | None = None
    glass: ShotGlass | None = None
    look: Callable[[int, Camera, AbstractLens], AbstractLens] | None = None
    camera_at: Callable[[float], Camera] | None = None

    def __post_init__(self) -> None:
        if not self.cameras or len(self.cameras) != len(self.lenses):
            raise ValueError(
                f"the shot has {len(self.cameras)} cameras and {len(self.lenses)} lenses; expected one each"
                " per frame"
            )
        if self.surface is not None and not all(isinstance(lens, ThinLens) for lens in self.lenses):
            raise ValueError("the shot has a focal surface and a lens that is turned; leave one of them out")

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
    solution: FramesSolution | SurfaceFramesSolution
    share: Float[np.ndarray, "t m"]
    depths: Float[np.ndarray, "t 2"]

    @cached_property
    def diagnosis(self) -> FramesDiagnosis:
        """What keeps the lenses from meeting the wishes, judged where these count in full."""
        if not self.shot.wishes:
            return FramesDiagnosis((), (), (), {}, (), (), ())
        return diagnose(self.solution, counts=self.share > 1.0 - 1e-6)

    def seen_with(self, number: int, *, fit: bool = True) -> tuple[Camera, AbstractLens]:
        """Camera and lens that make the picture of a frame, counted from 1.

        Args:
            number: of the frame.
            fit: of a real lens, whether to trace polynomials for its rays where they are good enough.
        """
        camera, lens = self.solution.at(number - 1)
        if self.shot.glass is not None:
            return camera, self._glass_at(number, fit)
        look = self.shot.look
        return camera, lens if look is None else look(number, camera, lens)

    def _glass_at(self, number: int, fit: bool) -> AbstractLens:
        """The real lens of a frame."""
        known = self._known.get((number, fit))
        if known is None:
            assert self.shot.glass is not None
            camera, lens = self.solution.at(number - 1)
            assert isinstance(lens, ThinLens | TiltShiftLens)
            known = self.shot.glass.to_render(number, camera, lens, self.depths[number - 1], fit=fit)
            self._known[number, fit] = known
        return known

    @cached_property
    def _known(self) -> dict[tuple[int, bool], AbstractLens]:
        return {}

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
    """The lenses of all frames of a shot, solved together; those given, where nothing is wished.

    Args:
        shot: what to solve.
        throw: raise an error when the solver fails.
        progress: called with the stage that runs and the share of it that is done.
        disparities: `disparity_map` of a frame by its number, where these are at hand.

    Raises:
        ValueError: as `find_wishes` and `solve_frames`.
        RuntimeError: the solver failed, and `throw` is true.
    """
    report: Progress = progress if progress is not None else lambda stage, share: None
    depths: list[tuple[float, float]] = []

    def views() -> Iterator[dict[str, Any]]:
        """What each frame shows; a frame that is as the one before it is not looked at again."""
        known: tuple[Scene, Camera, np.ndarray] | None = None
        for number, camera in enumerate(shot.cameras):
            report("locate", number / shot.count)
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

    surface, wishes = shot.surface, shot.wishes
    controls = () if surface is None else surface.controls
    if surface is not None or wishes:
        require_fade(shot.fade_frames)
    # Also where nothing is looked for: what is seen decides how far layers reach.
    found = located([group for group in (controls, wishes) if group], shot.cameras, views())
    surfaces, thin = None, [lens for lens in shot.lenses if isinstance(lens, ThinLens)]
    if surface is not None:
        of_controls, *found = found
        surfaces = find_surfaces(surface, shot.cameras, thin, of_controls, fade_frames=shot.fade_frames)
    share = np.zeros((shot.count, 0))
    if wishes:
        (of_wishes,) = found
        faded = counted(
            wishes, of_wishes, fade_frames=shot.fade_frames, favour_near=shot.favour_near, called="wish"
        )
        points, share = faded.points, faded.share
        report("solve", None)
        over_time = {"smoothness": shot.smoothness, "steadiness": shot.steadiness}
        if surfaces is None:
            solving = solve_frames if shot.glass is None else partial(solve_through_glass, shot.glass)
            solution = solving(
                points,
                shot.cameras,
                shot.lenses,
                held=shot.held,
                throw=throw,
                **over_time,
                **shot.options,
            )
        else:
            assert surface is not None
            solution = solve_surface_frames(
                points, shot.cameras, surfaces, thin, roughness=surface.roughness, **over_time
            )
    elif surfaces is None:
        solution = unsolved(shot.cameras, shot.lenses, shot.options.get("close_focus", "ignored"))
    else:
        solution = unsolved_surfaces(shot.cameras, surfaces, thin)
    return SolvedShot(shot, solution, share, np.array(depths))
