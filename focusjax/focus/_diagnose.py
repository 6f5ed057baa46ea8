"""One question for every kind of solution: what keeps it from being better?"""

from collections.abc import Sequence
from typing import overload

import numpy as np
from jaxtyping import Bool

from focusjax._arguments import ArgumentError, require_kind
from focusjax.focus._diagnose_frames import FramesDiagnosis, diagnose_frames
from focusjax.focus._diagnose_picture import Diagnosis, diagnose_picture
from focusjax.focus._diagnose_surface import SurfaceDiagnosis, diagnose_surface
from focusjax.focus._frames_solution import FramesSolution
from focusjax.focus._solution import Solution
from focusjax.focus._solve_surface import SurfaceSolution
from focusjax.focus._solve_surface_frames import SurfaceFramesSolution


@overload
def diagnose(solution: Solution) -> Diagnosis: ...
@overload
def diagnose(solution: SurfaceSolution, *, controls: Sequence[str] = ()) -> SurfaceDiagnosis: ...
@overload
def diagnose(
    solution: FramesSolution | SurfaceFramesSolution, *, counts: Bool[np.ndarray, "t m"] | None = None
) -> FramesDiagnosis: ...
def diagnose(
    solution: Solution | SurfaceSolution | FramesSolution | SurfaceFramesSolution,
    *,
    counts: Bool[np.ndarray, "t m"] | None = None,
    controls: Sequence[str] = (),
) -> Diagnosis | SurfaceDiagnosis | FramesDiagnosis:
    """What keeps a solution from being better: of one picture, of a focal surface, or of a shot.

    Solves again without each wish, and for each missed wish alone; that compiles nothing new. Of a shot this
    is done only when some wish is missed. Through glass, errors are those at nearly the best settings: within
    2 % of what solving again says of two wishes that a double Gauss cannot both meet.

    Args:
        solution: as `solve`, `solve_focal_surface`, `solve_frames` or `solve_surface_frames` returned it,
            with known values.
        counts: of a shot, the frames in which each wish is to be judged; all in which it has weight when not
            given.
        controls: of a focal surface, names of its control points, to call them by instead of numbers.

    Raises:
        ArgumentError: what is no solution; the whole of what `solve_many` returned, of which `at` gives one
            to diagnose; or names that are not as many as control points.

    Example:
        >>> import jax.numpy as jnp
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
    kinds = (Solution, SurfaceSolution, FramesSolution, SurfaceFramesSolution)
    require_kind(solution, kinds, "diagnose(solution)", "`solve` and its like return one", "solution")
    if isinstance(solution, FramesSolution | SurfaceFramesSolution):
        return diagnose_frames(solution, counts)
    if isinstance(solution, SurfaceSolution):
        return diagnose_surface(solution, controls)
    if np.ndim(solution.cost) > 0:
        raise ArgumentError(
            f"the solution is of {len(solution.cost)} problems; diagnose one of them, such as"
            " `solution.at(0)`",
            "solution",
        )
    return diagnose_picture(solution)
