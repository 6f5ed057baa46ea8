"""What a solve found: the lens, how well each wish is met, and what stood in the way."""

import dataclasses
import itertools
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from focusjax._arguments import ArgumentError
from focusjax._device import device_array
from focusjax.focus._bounds import LOWER_NAMES, UPPER_NAMES, Box, Limits
from focusjax.focus._image_points import ACROSS, AT_LEAST, AT_MOST, BLUR, EQUAL, SAME, ImagePoints
from focusjax.focus._parameters import PARAMETERS
from focusjax.focus._priors import Numbers
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, CloseFocus, LensSettings, ThinLens, TiltShiftLens, lens_settings

Tree = TypeVar("Tree")

PARTLY_OPEN = 0.01
"""Squared cosine between a parameter's axis and what is open from which on the parameter is called open."""
_RELATIONS = {EQUAL: "equal", AT_MOST: "at most", AT_LEAST: "at least", SAME: "same"}
SHOWN_AT, IN_FRAME = "shown at", "in frame"
"""Relations of wishes about where something is shown, which are not about blur."""


class Result(eqx.Enumeration):
    """How a solve ended."""

    solved = "The wishes and the bounds determine every parameter."
    undetermined = (
        "The solution is optimal, but the wishes leave a parameter open, which is as the starting lens"
        " had it. More wishes, at another distance or of another blur, would determine it."
    )
    max_steps_reached = "The solver took as many steps as it was allowed without settling; allow more steps."
    not_finite = "The solver met a value that is not finite; check the focus points and the lens."


def result_of(
    settled: Bool[Array, ""],
    is_open: Bool[Array, "k"],
    error: Float[Array, "*t n"],
    result: Result = Result.solved,
) -> Result:
    """How a solve ended, of which the last part ended with `result`."""
    result = Result.where(settled, result, Result.max_steps_reached)
    result = Result.where((result == Result.solved) & jnp.any(is_open), Result.undetermined, result)
    return Result.where(jnp.all(jnp.isfinite(error)), result, Result.not_finite)


def has_failed(result: Result) -> Bool[Array, ""]:
    """Whether the solver failed."""
    return (result == Result.max_steps_reached) | (result == Result.not_finite)


@dataclasses.dataclass(frozen=True)
class WishResult:
    """One line of the table of wishes; for an object, its worst sample speaks.

    Of a wish for where something is shown, `wished` and `got` are distances in pixels: from the wished place
    (0 is wished), or inside the frame from its nearest edge, negative outside; `xy` is where it is shown.

    Attributes:
        name: the focus point's name.
        relation: "equal", "at most", "at least", or "same" (as another point's blur); "shown at",
            "in frame".
        wished: blur diameter in pixels, signed when `signed`.
        signed: whether the wish says on which side of the focus the point is to be.
        got: signed blur diameter in pixels.
        residual: error in pixels: got (its size, when unsigned) - wished, 0 where a limit is kept.
        tolerance: largest error in pixels that counts as met.
        met: whether all samples are within the tolerance.
        weight: of the whole wish, after fading.
        note: what became of the wish, such as "hidden"; empty when it counts in full.
        xy: image position in pixels.
        distance: depth in metres along the view axis; infinite on the background.
        samples: number of points that carry the wish.
        partner: name of the point whose blur is wished, where the relation is "same".
    """

    name: str
    relation: str
    wished: float
    signed: bool
    got: float
    residual: float
    tolerance: float
    met: bool
    weight: float
    note: str
    xy: tuple[float, float]
    distance: float
    samples: int
    partner: str = ""

    @property
    def counts(self) -> bool:
        """Whether it has a weight, and its place is in the picture or counts although it is not."""
        return self.weight > 0


@dataclasses.dataclass(frozen=True)
class Plan:
    """What of a solve is known before it runs, and is compiled in.

    Attributes:
        free: parameters to solve for, in the order of `PARAMETERS`.
        keep_view: whether the sensor grows with the focal length.
        exact: whether the optimum is found in closed form (`find_optimum`).
        many: whether some wishes leave their side open, so that one start may not do.
        max_steps: steps allowed.
        solver: of Optimistix; None for `BoundedLevenbergMarquardt`.
        close_focus: what stays as the focus moves.
    """

    free: tuple[str, ...]
    keep_view: bool
    exact: bool
    many: bool
    max_steps: int
    solver: Any = None
    close_focus: CloseFocus = "ignored"


class Asked(eqx.Module):
    """One problem, its values checked.

    Attributes:
        points: located wishes.
        camera: the pinhole that frames the picture.
        lens: where to start.
        limits: bounds.
        numbers: priors by name.
        plan: what is static.
        glass: the real lens that makes the picture, as wide as it opens; None for ideal lenses.
    """

    points: ImagePoints
    camera: Camera
    lens: ThinLens | TiltShiftLens
    limits: Limits
    numbers: Numbers
    plan: Plan = eqx.field(static=True)
    glass: AbstractLens | None = None

    @property
    def box(self) -> Box:
        """The bounds on all parameters."""
        return self.limits.box(self.camera, self.plan.close_focus)


class AbstractPrinted(eqx.Module):
    """A solution that `print` and notebooks show: settings, wishes and diagnosis."""

    # The diagnosis solves again, and so knows of solutions: `_printed` is imported late.
    def __str__(self) -> str:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return repr(self)
        from focusjax.focus._printed import printed

        return printed(self)

    def _repr_html_(self) -> str:
        from focusjax.focus._printed import as_html

        return as_html(self)


class Solution(AbstractPrinted):
    """The solved lens and how it was found. A pytree; the lens and camera carry gradients.

    That of `solve_many` has a leading axis on every array, and `at` gives one of its solutions.

    Attributes:
        lens: the solved lens; its aperture's shape is that of the starting lens.
        camera: the camera, with the solved focal length when that was free.
        points: what was asked, where the camera sees it.
        blur: signed blur diameter in pixels at every point.
        error: difference from the wish in pixels at every point (see `errors`).
        cost: half the sum of weight x error^2 and of the squared priors, in px^2.
        result: how the solve ended.
        steps: steps the solver took.
        at_lower: for every free parameter, whether the lower bound keeps it from a better value.
        at_upper: the same for upper bounds.
        open: for every free parameter, whether the wishes leave it open, alone or together with others, so
            that it stayed as near to the start as it could.
        free: what was solved for, in the order of `PARAMETERS` (static).
        asked: the problem.
        glass: the real lens of these settings, of which `blur` and `error` are; None for ideal lenses.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> start = fj.thin_lens(focus_distance=5, f_number=2, focal_length=0.05)
        >>> wishes = [fj.FocusPoint(fj.AtPoint((0, 0, -z)), fj.Sharp()) for z in (2, 4)]
        >>> solution = fj.solve(fj.locate(wishes, camera), camera, start)
        >>> solution.blur.round(4).tolist()
        [-1.5625, 1.5625]
    """

    lens: ThinLens | TiltShiftLens
    camera: Camera
    points: ImagePoints
    blur: Float[Array, "*p n"]
    error: Float[Array, "*p n"]
    cost: Float[Array, "*p"]
    result: Result
    steps: Int[Array, "*p"]
    at_lower: Bool[Array, "*p k"]
    at_upper: Bool[Array, "*p k"]
    open: Bool[Array, "*p k"]
    free: tuple[str, ...] = eqx.field(static=True)
    asked: Asked | None = None
    glass: AbstractLens | None = None

    def at(self, index: int) -> "Solution":
        """One of the solutions that `solve_many` found, counted from 0."""
        if np.ndim(self.cost) == 0:
            raise ArgumentError(
                "the solution is of one problem, and has no `at`; use it as it is", "solution"
            )
        if not -len(self.cost) <= index < len(self.cost):
            raise ArgumentError(
                f"there are {len(self.cost)} solutions, and no number {index} (counted from 0)", "index"
            )
        return one_row(self, index)

    def _alone(self, what: str) -> None:
        """Refuses to say of many problems what only one has."""
        if np.ndim(self.cost) > 0:
            raise ArgumentError(
                f"the solution is of {len(self.cost)} problems; `solution.at(0).{what}` is for the first of"
                " them",
                "solution",
            )

    @property
    def met(self) -> Bool[Array, "*p n"]:
        """Whether each point's error is within its tolerance."""
        return jnp.abs(self.error) <= self.points.tolerance

    @property
    def active_bounds(self) -> tuple[str, ...]:
        """Bounds that keep a parameter from a better value, such as "min_focus_distance"."""
        self._alone("active_bounds")
        columns = [PARAMETERS.index(name) for name in self.free]
        names = [*(LOWER_NAMES[column] for column in columns), *(UPPER_NAMES[column] for column in columns)]
        flags = np.concatenate([np.asarray(self.at_lower), np.asarray(self.at_upper)])
        return tuple(itertools.compress(names, flags))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that the wishes leave open, such as "f_number"."""
        self._alone("undetermined")
        return tuple(itertools.compress(self.free, np.asarray(self.open)))

    def settings(self) -> LensSettings:
        """Focal length, f-number and magnification in the model of close focus that was solved with."""
        close_focus = "ignored" if self.asked is None else self.asked.plan.close_focus
        return lens_settings(self.camera, self.lens, close_focus)

    def table(self) -> tuple[WishResult, ...]:
        """One line per wish, in the order they were given."""
        self._alone("table()")
        return wish_table(self.points, self.blur, self.error)


def wish_table(
    points: ImagePoints,
    blur: Float[Array, "*t n"],
    error: Float[Array, "*t n"],
    frame: int | None = None,
) -> tuple[WishResult, ...]:
    """One line per wish, given the signed blur and the error in pixels at every point, or of one frame."""
    # Once to numpy: picking entries out of JAX arrays takes milliseconds each.
    points, blur, error = jax.tree.map(np.asarray, (points, blur, error))
    if frame is not None:
        points, blur, error = jax.tree.map(lambda leaf: leaf[frame], (points, blur, error))
    met = np.abs(error) <= points.tolerance
    lines = []
    for index, name in enumerate(points.names):
        rows = np.flatnonzero(points.wish == index)
        worst = rows[np.argmax(np.abs(error[rows]))]
        disparity = float(points.disparity[worst])
        relation = _RELATIONS[EQUAL if points.relation is None else int(points.relation[worst])]
        wished, got, residual = (float(of[worst]) for of in (points.target, blur, error))
        weight = float(points.weight[rows].sum())
        kept = bool(met[rows].all())
        if points.quantity is not None and points.quantity[worst] != BLUR:
            relation, wished, got, residual = _framing(points, rows, np.asarray(error))
            weight = float(points.weight[worst])
            kept = abs(residual) <= points.tolerance[worst]
        lines.append(
            WishResult(
                name=name,
                relation=relation,
                wished=wished,
                signed=bool(points.signed[worst]),
                got=got,
                residual=residual,
                tolerance=float(points.tolerance[worst]),
                met=bool(kept),
                weight=weight,
                note=points.notes[index] if points.notes else "",
                xy=(float(points.xy[worst, 0]), float(points.xy[worst, 1])),
                distance=1.0 / disparity if disparity > 0 else float("inf"),
                samples=len(rows),
                partner=points.partners[index] if points.partners else "",
            )
        )
    return tuple(lines)


def _framing(
    points: ImagePoints, rows: Int[np.ndarray, "r"], error: Float[np.ndarray, "n"]
) -> tuple[str, float, float, float]:
    """Relation, wished, got and residual of a wish about where something is shown."""
    if len(rows) < 4:
        off = float(np.hypot.reduce(error[rows]))
        return SHOWN_AT, 0.0, off, off
    assert points.quantity is not None
    assert points.relation is not None
    # The left and upper ends are to be at least at the margin.
    margin = float(points.target[rows[0]])
    short = np.abs(error[rows]).max()
    place = np.where(points.quantity[rows] == ACROSS, *points.xy[rows].T)
    room = np.where(points.relation[rows] == AT_LEAST, 1.0, -1.0) * (place - points.target[rows])
    return IN_FRAME, margin, margin + float(room.min()), -float(short)


def one_row(tree: Tree, index: int) -> Tree:
    """One entry of the leading axis of every array; by numpy where it can be, which compiles nothing."""

    def row(leaf: Array) -> Array:
        return leaf[index] if isinstance(leaf, Tracer) else device_array(np.asarray(leaf)[index])

    return jax.tree.map(row, tree)


def first_rows(tree: Tree, count: int) -> Tree:
    """Every array without its padding; by numpy where it can be, which compiles nothing."""

    def rows(leaf: Array) -> Array:
        if leaf.shape[0] == count:
            return leaf
        return leaf[:count] if isinstance(leaf, Tracer) else device_array(np.asarray(leaf)[:count])

    return jax.tree.map(rows, tree)
