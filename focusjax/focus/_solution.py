"""What a solve found: the lens, how well each wish is met, and what stood in the way."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import LOWER_NAMES, UPPER_NAMES
from focusjax.focus._image_points import ImagePoints
from focusjax.lens import ThinLens

PARAMETER_NAMES = ("focus", "f_number")


class Result(eqx.Enumeration):
    """How a solve ended."""

    solved = "The wishes and the bounds determine every parameter."
    undetermined = (
        "The solution is optimal, but the wishes leave a parameter open, which is as the starting lens"
        " had it. More wishes, at another distance or of another blur, would determine it."
    )
    max_steps_reached = "The solver took as many steps as it was allowed without settling; allow more steps."
    not_finite = "The solver met a value that is not finite; check the focus points and the lens."


@dataclasses.dataclass(frozen=True)
class WishResult:
    """One line of the table of wishes; for an object, its worst sample speaks.

    Attributes:
        name: the focus point's name.
        wished: blur diameter in pixels, signed when `signed`.
        signed: whether the wish says on which side of the focus the point is to be.
        got: signed blur diameter in pixels.
        residual: error in pixels: got (its size, when unsigned) - wished.
        tolerance: largest error in pixels that counts as met.
        met: whether all samples are within the tolerance.
        weight: of the whole wish.
        xy: image position in pixels.
        distance: depth in metres along the view axis; infinite on the background.
        samples: number of points that carry the wish.
    """

    name: str
    wished: float
    signed: bool
    got: float
    residual: float
    tolerance: float
    met: bool
    weight: float
    xy: tuple[float, float]
    distance: float
    samples: int


class Solution(eqx.Module):
    """The solved lens and how it was found. A pytree; the lens carries gradients.

    Attributes:
        lens: the solved lens; its aperture's shape is that of the starting lens.
        points: what was asked.
        blur: signed blur diameter in pixels at every point.
        error: difference from the wish in pixels at every point (see `errors`).
        cost: half the sum of weight x error^2, in px^2.
        result: how the solve ended.
        steps: steps the solver took.
        at_lower: for focus disparity and aperture radius, whether the lower bound keeps the parameter
            from a better value.
        at_upper: the same for upper bounds.
        held: whether the wishes leave the parameter open, so that it stayed as it was.
    """

    lens: ThinLens
    points: ImagePoints
    blur: Float[Array, "n"]
    error: Float[Array, "n"]
    cost: Float[Array, ""]
    result: Result
    steps: Int[Array, ""]
    at_lower: Bool[Array, "2"]
    at_upper: Bool[Array, "2"]
    held: Bool[Array, "2"]

    @property
    def met(self) -> Bool[Array, "n"]:
        """Whether each point's error is within its tolerance."""
        return jnp.abs(self.error) <= self.points.tolerance

    @property
    def active_bounds(self) -> tuple[str, ...]:
        """Bounds that keep a parameter from a better value, such as "min_focus_distance"."""
        names = (*LOWER_NAMES, *UPPER_NAMES)
        flags = np.concatenate([np.asarray(self.at_lower), np.asarray(self.at_upper)])
        return tuple(name for name, active in zip(names, flags, strict=True) if active)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that the wishes leave open, "focus" or "f_number"."""
        return tuple(name for name, held in zip(PARAMETER_NAMES, np.asarray(self.held), strict=True) if held)

    def table(self) -> tuple[WishResult, ...]:
        """One line per wish, in the order they were given."""
        return wish_table(self.points, self.blur, self.error)


def wish_table(
    points: ImagePoints, blur: Float[Array, "n"], error: Float[Array, "n"]
) -> tuple[WishResult, ...]:
    """One line per wish, given the signed blur and the error in pixels at every point."""
    # Once to numpy: picking entries out of JAX arrays takes milliseconds each.
    points, blur, error = jax.tree.map(np.asarray, (points, blur, error))
    met = np.abs(error) <= points.tolerance
    lines = []
    for index, name in enumerate(points.names):
        rows = np.flatnonzero(points.wish == index)
        worst = rows[np.argmax(np.abs(error[rows]))]
        disparity = float(points.disparity[worst])
        lines.append(
            WishResult(
                name=name,
                wished=float(points.target[worst]),
                signed=bool(points.signed[worst]),
                got=float(blur[worst]),
                residual=float(error[worst]),
                tolerance=float(points.tolerance[worst]),
                met=bool(met[rows].all()),
                weight=float(points.weight[rows].sum()),
                xy=(float(points.xy[worst, 0]), float(points.xy[worst, 1])),
                distance=1.0 / disparity if disparity > 0 else float("inf"),
                samples=len(rows),
            )
        )
    return tuple(lines)
