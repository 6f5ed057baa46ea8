"""What a person asks for: a place in the scene, and how sharp or blurred it should be.

Diameters, margins, places in the picture, weights and tolerances may be traced by `jax.jit` and `jax.grad`,
so that a solve can be differentiated by them; so may world positions and directions of points that count in
any case (see `locate`). What is traced is checked when the compiled solve runs.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, SupportsFloat, SupportsIndex, TypeAlias, get_args

import numpy as np
from jaxtyping import Array, Bool

from focusjax._arguments import number_or_traced, real_number, require_switches
from focusjax._counts import require_counts
from focusjax._words import kind_of
from focusjax.focus._units import Diameter, amount
from focusjax.focus._wishes import MOST_AMOUNT, InFrame, ShownAt, Wish, check_range

MOST_WEIGHT = 1e12

Vector: TypeAlias = Sequence[SupportsFloat] | np.ndarray | Array


@dataclasses.dataclass(frozen=True)
class AtPixel:
    """Whatever is seen first at an image position; the background counts as infinitely far.

    Attributes:
        x: pixels to the right of the frame's left edge (pixel centres at half-integers).
        y: pixels below the frame's top edge.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> wish = fj.FocusPoint(fj.AtPixel(4.5, 2.5), fj.Sharp())
        >>> round(float(fj.find_points([wish], fj.make_scene([wall]), camera).disparity[0]), 6)
        0.5
    """

    x: SupportsFloat
    y: SupportsFloat

    def __post_init__(self) -> None:
        for each, axis in ((self.x, "x"), (self.y, "y")):
            real_number(each, f"{axis} of a focus point's pixel", "a number of pixels")


@dataclasses.dataclass(frozen=True)
class AtPoint:
    """A fixed world position [3] in metres, whether or not something is there to be seen.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> found = fj.locate([fj.FocusPoint(fj.AtPoint((0, 0, -2)), fj.Sharp())], camera)
        >>> found.xy.round(6).tolist(), found.disparity.round(6).tolist()
        ([[4.0, 3.0]], [0.5])
    """

    position: Vector


@dataclasses.dataclass(frozen=True)
class AtInfinity:
    """A world direction [3] of any length from the camera: a star, the far end of a street.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> found = fj.locate([fj.FocusPoint(fj.AtInfinity((0, 0, -1)), fj.Sharp())], camera)
        >>> found.xy.round(6).tolist(), abs(found.disparity).tolist()
        ([[4.0, 3.0]], [0.0])
    """

    direction: Vector


@dataclasses.dataclass(frozen=True)
class OnTriangle:
    """A point of the mesh, which stays on the mesh when its vertices move (Lee10 §5).

    Attributes:
        face: row of the scene's faces.
        barycentric: weights [3] of that face's corners; not negative, their sum is 1.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> wish = fj.FocusPoint(fj.OnTriangle(0, (0.25, 0.25, 0.5)), fj.Sharp())
        >>> found = fj.find_points([wish], fj.make_scene([wall]), camera)
        >>> found.xy.round(6).tolist(), found.disparity.round(6).tolist()
        ([[4.0, 3.0]], [0.5])
    """

    face: SupportsIndex
    barycentric: Vector

    def __post_init__(self) -> None:
        if isinstance(self.face, bool) or not isinstance(self.face, SupportsIndex):
            raise ValueError(f"a triangle's face is {self.face!r}; expected its row in the scene's faces")


@dataclasses.dataclass(frozen=True)
class OnObject:
    """The visible surface of a named object, as points spread evenly over its area.

    Attributes:
        name: the object's name in the scene.
        samples: at most this many visible points carry the wish, and share its weight.

    Example:
        >>> card = fj.make_object("card", [(-0.5, -0.4, -2), (0.5, -0.4, -2), (0, 0.4, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> wish = fj.FocusPoint(fj.OnObject("card", samples=4), fj.Sharp())
        >>> found = fj.find_points([wish], fj.make_scene([card]), camera)
        >>> found.disparity.round(6).tolist(), found.weight.tolist()
        ([0.5, 0.5, 0.5, 0.5], [0.25, 0.25, 0.25, 0.25])
    """

    name: str
    samples: int = 64

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise ValueError(f"an object's name is {self.name!r}; expected the text it has in the scene")
        require_counts(**{f"the number of samples of object {self.name!r}": self.samples})


@dataclasses.dataclass(frozen=True, eq=False)
class OnMask:
    """The surface seen first under a part of the picture, as points spread evenly over that part.

    Background counts only where a mask holds nothing else.

    Attributes:
        mask: which pixels [h, w] are meant.
        samples: at most this many pixels carry the wish, and share its weight.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> left_half = np.arange(8) < np.full((6, 1), 4)
        >>> wish = fj.FocusPoint(fj.OnMask(left_half, samples=4), fj.Sharp())
        >>> found = fj.find_points([wish], fj.make_scene([wall]), camera)
        >>> found.disparity.round(6).tolist(), bool((found.xy[:, 0] < 4).all())
        ([0.5, 0.5, 0.5, 0.5], True)
    """

    mask: Bool[np.ndarray, "h w"]
    samples: int = 64

    def __post_init__(self) -> None:
        if not np.issubdtype(getattr(self.mask, "dtype", np.void), np.bool_):
            raise ValueError(
                f"a mask is {kind_of(self.mask)}; expected an array of True and False, one for each pixel, as"
                " image > 0.5 makes"
            )
        require_counts(**{"the number of samples of a mask": self.samples})


@dataclasses.dataclass(frozen=True)
class InDepthRange:
    """Everything between two distances along the view axis, in the middle of the picture.

    Attributes:
        near: metres along the view axis.
        far: metres, more than `near`; may be infinite.
        samples: number of points that carry the wish and share its weight, evenly spaced in disparity,
            as blur is; `near` and `far` are the first and the last.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> found = fj.locate([fj.FocusPoint(fj.InDepthRange(1, 2, samples=3), fj.Sharp())], camera)
        >>> found.disparity.round(6).tolist()
        [1.0, 0.75, 0.5]
    """

    near: SupportsFloat
    far: SupportsFloat
    samples: int = 16

    def __post_init__(self) -> None:
        ends = (self.near, "start"), (self.far, "end")
        near, far = (
            real_number(value, f"the depth range's {end}", "a distance in metres such as 2.0")
            for value, end in ends
        )
        if not 0 < near < far:
            raise ValueError(f"the depth range is {near} m to {far} m; expected 0 < near < far")
        require_counts(samples=self.samples)
        if self.samples < 2:
            raise ValueError(f"the depth range has {self.samples} samples; expected at least 2, for its ends")


Attachment: TypeAlias = AtPixel | AtPoint | AtInfinity | OnTriangle | OnObject | OnMask | InDepthRange


@dataclasses.dataclass(frozen=True)
class FocusPoint:
    """One wish about one place.

    A wish adds weight x (error in pixels)^2 to what the solve minimises. `AtMost`, `AtLeast` and `InFrame`
    have no error on their good side.

    Attributes:
        where: the place.
        wish: sharp, a blur diameter, a limit to it, or that of another point; or where it is to be shown.
        weight: importance; 0 reports the point without letting it count.
        tolerance: error up to which the wish is called met, in pixels or a length of another kind.
        name: how reports call the wish; "point 1", "point 2", ... in order when empty.
        even_outside: whether the wish counts even when its place is outside the frame (Lee10 §5).
        even_hidden: whether the wish counts in full even when something hides its place; otherwise its
            weight fades as that happens.

    Example:
        >>> FocusPoint(AtPixel(320, 200), fj.Blur(30), name="lamp").weight
        1.0
    """

    where: Attachment
    wish: Wish
    weight: SupportsFloat = 1.0
    tolerance: Diameter = 1.0
    name: str = ""
    even_outside: bool = False
    even_hidden: bool = False

    def __post_init__(self) -> None:
        require_switches(even_outside=self.even_outside, even_hidden=self.even_hidden)
        label = f"focus point {self.name!r}" if self.name else "a focus point"
        check_kind(f"{label} has place", self.where, Attachment)
        check_kind(f"{label} has wish", self.wish, Wish)
        if isinstance(self.where, InDepthRange) and isinstance(self.wish, ShownAt | InFrame):
            raise ValueError(
                f"{label} is a depth range, which is nowhere in the picture; give it another wish"
            )
        weight = number_or_traced(self.weight, f"the weight of {label}", "zero or a positive finite number")
        check_range(f"{label} has weight", weight, MOST_WEIGHT)
        check_range(f"{label} has tolerance", amount(self.tolerance), MOST_AMOUNT)


def check_kind(what: str, value: object, kinds: Any) -> None:
    """Refuse a value that is none of a union's classes, for callers who do not check types."""
    if not isinstance(value, kinds):
        names = ", ".join(kind.__name__ for kind in get_args(kinds))
        raise ValueError(f"{what} {value!r}; expected one of {names}")
