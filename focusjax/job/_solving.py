"""The solves of a run, timed."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax

from focusjax._stopwatch import Stopwatch
from focusjax.config import Config, refusals_located
from focusjax.focus import ImagePoints, Solution, SurfaceSolution, solve, solve_focal_surface
from focusjax.geometry import Camera
from focusjax.job._exposed import ExposedSolution
from focusjax.job._weigh import weighed_solution
from focusjax.lens import FocalSurface, ThinLens, TiltShiftLens


def solved_lens(
    config: Config,
    options: Mapping[str, Any],
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    grey: float | None,
    watch: Stopwatch,
    stage: str = "solve",
) -> tuple[Solution, ExposedSolution | None]:
    """The solution; with a metered `grey` the light is asked, too, and what that says comes second."""
    with watch.stage(stage), refusals_located(config):
        exposed = None
        if grey is None:
            solution = solve(points, camera, lens, **options)
        else:
            exposed = weighed_solution(config, options, points, camera, lens, grey)
            solution = exposed.solution
        jax.block_until_ready(eqx.filter(solution.lens, eqx.is_array))
    return solution, exposed


def solved_surface(
    config: Config,
    points: ImagePoints,
    camera: Camera,
    surface: FocalSurface,
    lens: ThinLens,
    watch: Stopwatch,
) -> SurfaceSolution:
    """As `solved_lens`, for the control values of a focal surface."""
    assert config.lens.focal_surface is not None
    smoothness = config.lens.focal_surface.smoothness
    with watch.stage("solve"), refusals_located(config):
        solution = solve_focal_surface(points, camera, surface, lens, smoothness=smoothness)
        jax.block_until_ready(solution.cost)
    return solution
