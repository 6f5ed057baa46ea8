"""Many problems in one compiled call."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from focusjax._programs import jit
from focusjax.focus._image_points import ImagePoints, anonymous, named_like
from focusjax.focus._refuse import require_points
from focusjax.focus._solution import Asked, Solution
from focusjax.focus._solve import prepared, solved
from focusjax.geometry import Camera
from focusjax.lens import ThinLens, TiltShiftLens


def solve_many(
    points: ImagePoints, camera: Camera, lens: ThinLens | TiltShiftLens, *, throw: bool = True, **options: Any
) -> Solution:
    """The lenses that meet many sets of wishes best, each as `solve` finds it.

    Args:
        points: one set of wishes per entry of the leading axis that every array has (see `stacked`).
        camera: the pinhole that frames all pictures.
        lens: where to start.
        throw: raise an error when the solver fails for some set.
        options: as for `solve`, the same for all sets.

    Returns:
        A solution whose arrays have the leading axis of `points`.

    Raises:
        ValueError: as `solve`.
        RuntimeError: the solver failed for some set, and `throw` is true.

    Example:
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate, stacked
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> sets = [locate([FocusPoint(AtPoint((0, 0, -z)), Sharp())], camera) for z in (1.0, 2.0, 4.0)]
        >>> solve_many(stacked(sets), camera, start).lens.focus_disparity.round(6).tolist()
        [1.0, 0.5, 0.25]
    """
    usage = "solve_many(points, camera, lens)"
    require_points(points, usage, axes=2)
    asked = prepared(anonymous(points), camera, lens, usage=usage, axes=2, **options)
    solutions, failed = _solve_all(asked)
    if throw and bool(jnp.any(failed)):
        count = int(failed.sum())
        raise RuntimeError(
            f"the solver failed for {count} of {failed.size} problems, of which {int(failed.argmax())} is the"
            " first; `throw=False` and `Solution.result` say why"
        )
    assert solutions.asked is not None
    seen, wished = (named_like(each, points) for each in (solutions.points, solutions.asked.points))
    return dataclasses.replace(
        solutions, points=seen, asked=dataclasses.replace(solutions.asked, points=wished)
    )


@jit
def _solve_all(asked: Asked) -> tuple[Solution, Bool[Array, "p"]]:
    def one(points: ImagePoints) -> tuple[Solution, Bool[Array, ""]]:
        problem = dataclasses.replace(asked, points=points)
        solution, failed = solved(problem)
        return dataclasses.replace(solution, asked=problem), failed

    return jax.vmap(one)(asked.points)
