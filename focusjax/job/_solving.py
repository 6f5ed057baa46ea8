"""The lens and the camera that a run settles on: its solves, timed."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from focusjax._stopwatch import Stopwatch
from focusjax.config import Config, refusals_located
from focusjax.focus import (
    FocusPoint,
    ImagePoints,
    Solution,
    SurfaceSolution,
    reframes,
    solve,
    solve_focal_surface,
)
from focusjax.geometry import Camera
from focusjax.job._exposed import ExposedLens, ExposedSolution
from focusjax.job._find import find_wishes
from focusjax.job._glass import opened_as_glass, solved_through
from focusjax.job._weigh import weighed_solution
from focusjax.layers import disparity_map
from focusjax.lens import FocalSurface, FocalSurfaceLens, ThinLens, TiltShiftLens
from focusjax.scene import Scene


@dataclasses.dataclass(frozen=True)
class Settled:
    """Where a run is with its camera and lens; attributes as those of `Outcome`."""

    camera: Camera
    lens: ThinLens | TiltShiftLens | FocalSurfaceLens
    disparity: Float[np.ndarray, "h w"]
    points: ImagePoints | None
    surface: FocalSurface | None
    exposed: ExposedLens | ExposedSolution | None
    solution: Solution | SurfaceSolution | None = None


@dataclasses.dataclass(frozen=True)
class Settling:
    """What the solves of a run have in common.

    Attributes:
        config: what is asked for.
        scene: that wishes are about.
        wishes: where they are to be found again when the frame moves.
        options: of `solve`.
        grey: metered light, where the config's exposure has a priority.
        watch: times the stages.
    """

    config: Config
    scene: Scene
    wishes: Sequence[FocusPoint]
    options: Mapping[str, Any]
    grey: float | None
    watch: Stopwatch

    @property
    def _reframes(self) -> bool:
        """Whether solving moves things in the picture."""
        return reframes(self.config.solve.free, self.config.lens.close_focus)

    def settle(self, start: Settled) -> Settled:
        """The best settings: of a focal surface, of a thin or tilted lens, or through glass.

        What frames or tilts the picture, and what the light takes, an ideal lens settles before glass is
        looked through.
        """
        if start.surface is not None:
            return self._surface(start)
        if self.config.lens.real is None:
            return self._ideal(start)
        alone = set(self.config.solve.free) <= {"focus", "f_number"} and self.grey is None
        if alone and isinstance(start.lens, ThinLens):
            return self._through_glass(start, "solve")
        return self._through_glass(self._ideal(start), "solve_glass")

    def _surface(self, start: Settled) -> Settled:
        """The control values of a focal surface."""
        assert self.config.lens.focal_surface is not None
        assert start.points is not None
        assert start.surface is not None
        assert isinstance(start.lens, ThinLens)
        smoothness = self.config.lens.focal_surface.smoothness
        with self.watch.stage("solve"), refusals_located(self.config):
            solution = solve_focal_surface(
                start.points, start.camera, start.surface, start.lens, smoothness=smoothness
            )
            jax.block_until_ready(solution.cost)
        return dataclasses.replace(start, lens=solution.lens, surface=solution.surface, solution=solution)

    def _ideal(self, start: Settled) -> Settled:
        """A thin or tilted lens, and the camera where that is free."""
        free = set(self.config.solve.free)
        grey = self.grey if start.exposed is None else None
        found = self._solved(start, grey, "solve")
        if self._reframes:
            with self.watch.stage("locate_again"):
                disparity = np.asarray(disparity_map(self.scene, found.camera))
            found = dataclasses.replace(found, disparity=disparity)
        if free & {"shift", "rise"}:
            # The frame has moved, and with it what is inside.
            points = find_wishes(self.config, self.wishes, self.scene, found.camera, found.disparity)
            found = self._solved(dataclasses.replace(found, points=points), grey, "solve_again")
        return found

    def _solved(self, start: Settled, grey: float | None, stage: str) -> Settled:
        """One solve; with a metered `grey` of focus and light together."""
        points, camera, lens, exposed = start.points, start.camera, start.lens, start.exposed
        assert points is not None
        assert isinstance(lens, ThinLens | TiltShiftLens)
        options = opened_as_glass(self.config, self.options)
        with self.watch.stage(stage), refusals_located(self.config):
            if grey is None:
                solution = solve(points, camera, lens, **options)
            else:
                exposed = weighed_solution(self.config, options, points, camera, lens, grey)
                solution = exposed.solution
            jax.block_until_ready(eqx.filter(solution.lens, eqx.is_array))
        camera = solution.camera if self._reframes else camera
        return dataclasses.replace(
            start,
            camera=camera,
            lens=solution.lens,
            points=solution.points,
            exposed=exposed,
            solution=solution,
        )

    def _through_glass(self, start: Settled, stage: str) -> Settled:
        """Focus and f-number of a real lens, as far as `start` leaves them open."""
        points, lens, settled = start.points, start.lens, start.solution
        assert points is not None
        assert isinstance(lens, ThinLens | TiltShiftLens)
        assert not isinstance(settled, SurfaceSolution)
        with self.watch.stage(stage):
            solution = solved_through(self.config, self.options, points, start.camera, lens, settled)
        points = solution.points if settled is None else points
        return dataclasses.replace(start, lens=solution.lens, points=points, solution=solution)
