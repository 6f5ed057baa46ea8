"""The shots of a stack: focus distances and f-number, from the wishes and their tolerances."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from focusjax.focus import ImagePoints
from focusjax.geometry import Camera

_HALVINGS = 40
"""Of the range of f-numbers, in which the widest one is found that takes as few shots."""


@dataclass(frozen=True)
class StackShot:
    """One shot of a stack.

    Attributes:
        focus_distance: metres.
        near: nearest distance in metres that is blurred by no more than the circle of confusion.
        far: the farthest; may be infinite.
        names: the wishes that it makes sharp, or a part of whose samples.
        worst_px: largest blur in pixels of what it is to make sharp.
    """

    focus_distance: float
    near: float
    far: float
    names: tuple[str, ...]
    worst_px: float


@dataclass(frozen=True)
class StackPlan:
    """The fewest shots that make everything sharp somewhere.

    Attributes:
        shots: nearest first.
        f_number: of all of them.
        circle_px: the circle of confusion in pixels, the smallest tolerance of the wishes.
        hyperfocal: metres; a lens focused there is sharp from half of it to infinity.
        worst_px: for every sharp wish its largest blur in pixels, in the best shot for each of its samples.
        single_f_number: of the one shot at the smallest aperture.
        single_focus: its focus distance in metres, in the middle of what is wished sharp in dioptres.
        single_px: what `worst_px` would be with it.
    """

    shots: tuple[StackShot, ...]
    f_number: float
    circle_px: float
    hyperfocal: float
    worst_px: dict[str, float]
    single_f_number: float
    single_focus: float
    single_px: dict[str, float]

    def overlaps(self) -> tuple[float, ...]:
        """Dioptres by which the depth of field of each shot overlaps that of the next; negative is a gap."""
        return tuple(1.0 / b.near - 1.0 / a.far for a, b in zip(self.shots, self.shots[1:], strict=False))


def plan_stack(
    points: ImagePoints,
    camera: Camera,
    *,
    f_number: float | None = None,
    f_number_range: tuple[float, float] = (1.0, 32.0),
    min_focus_distance: float = 0.0,
) -> StackPlan:
    """The fewest shots in which every sharp wish is met by one of them.

    The blur of a point at disparity w (1/m) is 2 f E |w_f - w| pixels in a thin lens focused at w_f, with f
    in pixels and the radius E of its pupil in metres (`ThinLens`). So a tolerance c lets w_f be within
    c / (2 f E) of w, and the fewest shots are the fewest points that meet all these intervals. Each shot is
    focused in the middle of what its intervals have in common. Diffraction is not considered.

    Args:
        points: located wishes; those that are to be sharp count, each sample for itself.
        camera: the pinhole that frames the picture.
        f_number: of the lens; None for the widest one in the range that takes no more shots than the smallest
            aperture does.
        f_number_range: smallest and largest f-number of the lens.
        min_focus_distance: nearest distance in metres at which the lens focuses.

    Raises:
        ValueError: no wish is to be sharp, or one is nearer than the lens can make sharp.
    """
    chosen = np.asarray(points.weight) > 0
    chosen &= (np.asarray(points.target) == 0) & ~np.isnan(np.asarray(points.disparity))
    for column in (points.relation, points.quantity):
        if column is not None:
            chosen &= np.asarray(column) == 0
    if not chosen.any():
        raise ValueError("no wish is to be sharp; give [[focus]] tables with sharp = true")
    wish = np.asarray(points.wish)[chosen]
    rows = _Rows(
        np.asarray(points.disparity, dtype=float)[chosen],
        np.asarray(points.tolerance, dtype=float)[chosen],
        tuple(points.names[number] for number in wish.tolist()),
        float(camera.focal_px) * float(camera.focal_length),
        math.inf if min_focus_distance == 0 else 1.0 / min_focus_distance,
    )
    widest, narrowest = f_number_range
    chosen_number = rows.widest_for_fewest(widest, narrowest) if f_number is None else f_number
    common, group = rows.groups(chosen_number)
    circle = float(rows.tolerance.min())
    half = circle / rows.pixels_per_dioptre(chosen_number)
    focus = common.mean(axis=1)
    blur = rows.blur(chosen_number, focus)
    shots = tuple(
        StackShot(
            focus_distance=1.0 / focus[number],
            near=1.0 / (focus[number] + half),
            far=1.0 / (focus[number] - half) if focus[number] > half else math.inf,
            names=tuple(dict.fromkeys(rows.names[row] for row in np.flatnonzero(group == number))),
            worst_px=float(blur[number, group == number].max()),
        )
        for number in np.argsort(-focus).tolist()
    )
    single = min(0.5 * (rows.disparity.min() + rows.disparity.max()), rows.nearest)
    single = single or half
    return StackPlan(
        shots=shots,
        f_number=chosen_number,
        circle_px=circle,
        hyperfocal=1.0 / half,
        worst_px=rows.worst(blur.min(axis=0)),
        single_f_number=narrowest,
        single_focus=1.0 / single,
        single_px=rows.worst(rows.blur(narrowest, np.array([single]))[0]),
    )


@dataclass(frozen=True)
class _Rows:
    """Samples that are to be sharp.

    Attributes:
        disparity: 1/m.
        tolerance: pixels.
        names: of their wishes.
        scale: focal length in pixels times that in metres.
        nearest: disparity in 1/m at which the lens focuses nearest.
    """

    disparity: Float[np.ndarray, "n"]
    tolerance: Float[np.ndarray, "n"]
    names: tuple[str, ...]
    scale: float
    nearest: float

    def pixels_per_dioptre(self, f_number: float) -> float:
        """Blur in pixels for each dioptre out of focus."""
        return self.scale / f_number

    def groups(self, f_number: float) -> tuple[np.ndarray, np.ndarray]:
        """What the shots' intervals have in common, and the shot of each sample."""
        half = self.tolerance / self.pixels_per_dioptre(f_number)
        lower, upper = np.maximum(self.disparity - half, 0.0), self.disparity + half
        if (lower > self.nearest).any():
            row = int(np.argmax(lower))
            raise ValueError(
                f"wish {self.names[row]!r} is {1.0 / self.disparity[row]:.3g} m away, and the lens focuses"
                f" from {1.0 / self.nearest:.3g} m on; move it or the camera, or lower"
                " solve.min_focus_distance_m"
            )
        return fewest_points(lower, np.minimum(upper, self.nearest))

    def widest_for_fewest(self, widest: float, narrowest: float) -> float:
        """The smallest f-number that takes as few shots as the largest: intervals only grow with it."""
        fewest = len(self.groups(narrowest)[0])
        low, high = widest, narrowest
        for _ in range(_HALVINGS):
            middle = math.sqrt(low * high)
            try:
                enough = len(self.groups(middle)[0]) <= fewest
            except ValueError:
                enough = False
            low, high = (low, middle) if enough else (middle, high)
        return high

    def blur(self, f_number: float, focus: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m n"]:
        """Blur diameter in pixels of every sample in every shot."""
        return self.pixels_per_dioptre(f_number) * np.abs(focus[:, None] - self.disparity)

    def worst(self, blur: Float[np.ndarray, "n"]) -> dict[str, float]:
        """The largest blur of every wish."""
        found: dict[str, float] = {}
        for name, value in zip(self.names, blur.tolist(), strict=True):
            found[name] = max(found.get(name, 0.0), value)
        return found


def fewest_points(
    lower: Float[np.ndarray, "n"], upper: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "m 2"], Int[np.ndarray, "n"]]:
    """Groups of closed intervals with something in common, as few as can be.

    The first point is the smallest upper end: some point has to meet that interval, and of those that do
    none meets more of the others. The intervals that it meets are one group, and the same goes for the rest.
    That is optimal (Gavril 1972, for cliques that cover an interval graph).

    Args:
        lower: lower ends.
        upper: upper ends, none below its lower end.

    Returns:
        What the intervals of each group have in common, its lower and upper end, in ascending order; and the
        group of each interval.

    Example:
        >>> common, group = fewest_points(np.array([0.0, 1.0, 3.0]), np.array([2.0, 4.0, 5.0]))
        >>> common.tolist(), group.tolist()
        ([[1.0, 2.0], [3.0, 5.0]], [0, 0, 1])
    """
    group = np.full(len(lower), -1)
    common: list[tuple[float, float]] = []
    for number in np.argsort(upper, kind="stable").tolist():
        if group[number] >= 0:
            continue
        members = (group < 0) & (lower <= upper[number]) & (upper >= upper[number])
        group[members] = len(common)
        common.append((float(lower[members].max()), float(upper[number])))
    return np.array(common).reshape(-1, 2), group
