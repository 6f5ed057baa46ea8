"""What a person asks for: a place in the scene, and how sharp or blurred it should be.

Diameters, margins, places in the picture, weights and tolerances may be traced by `jax.jit` and `jax.grad`,
so that a solve can be differentiated by them; so may world positions and directions of points that count in
any case (see `locate`). What is traced is checked when the compiled solve runs.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, SupportsFloat, SupportsIndex, TypeAlias, get_args

import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool

from focusjax._arguments import number_or_traced, real_number, require_switches
from focusjax._counts import require_counts
from focusjax._words import kind_of
from focusjax.focus._units import Diameter, amount

MOST_AMOUNT = 1e6
"""Largest diameter, margin or tolerance, in its own unit: no picture has as many pixels in a row."""

MOST_WEIGHT = 1e12

Vector: TypeAlias = Sequence[SupportsFloat] | np.ndarray | Array


@dataclasses.dataclass(frozen=True)
class AtPixel:
    """Whatever is seen first at an image position; the background counts as infinitely far.

    Attributes:
        x: pixels to the right of the frame's left edge (pixel centres at half-integers).
        y: pixels below the frame's top edge.
    """

    x: SupportsFloat
    y: SupportsFloat

    def __post_init__(self) -> None:
        _pixels(self.x, self.y, "a focus point's pixel")


@dataclasses.dataclass(frozen=True)
class AtPoint:
    """A fixed world position [3] in metres, whether or not something is there to be seen."""

    position: Vector


@dataclasses.dataclass(frozen=True)
class AtInfinity:
    """A world direction [3] of any length from the camera: a star, the far end of a street."""

    direction: Vector


@dataclasses.dataclass(frozen=True)
class OnTriangle:
    """A point of the mesh, which stays on the mesh when its vertices move (Lee10 §5).

    Attributes:
        face: row of the scene's faces.
        barycentric: weights [3] of that face's corners; not negative, their sum is 1.
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
    """

    name: str
    samples: int = 64

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise ValueError(f"an object's name is {self.name!r}; expected the text it has in the scene")
        _check_samples(self.samples, f"object {self.name!r}")


@dataclasses.dataclass(frozen=True, eq=False)
class OnMask:
    """The surface seen first under a part of the picture, as points spread evenly over that part.

    Background counts only where a mask holds nothing else.

    Attributes:
        mask: which pixels [h, w] are meant.
        samples: at most this many pixels carry the wish, and share its weight.
    """

    mask: Bool[np.ndarray, "h w"]
    samples: int = 64

    def __post_init__(self) -> None:
        if not np.issubdtype(getattr(self.mask, "dtype", np.void), np.bool_):
            raise ValueError(
                f"a mask is {kind_of(self.mask)}; expected an array of True and False, one for each pixel, as"
                " image > 0.5 makes"
            )
        _check_samples(self.samples, "a mask")


@dataclasses.dataclass(frozen=True)
class InDepthRange:
    """Everything between two distances along the view axis, in the middle of the picture.

    Attributes:
        near: metres along the view axis.
        far: metres, more than `near`; may be infinite.
        samples: number of points that carry the wish and share its weight, evenly spaced in disparity,
            as blur is; `near` and `far` are the first and the last.
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
class Sharp:
    """The point is in focus: its blur diameter is 0."""


@dataclasses.dataclass(frozen=True)
class Blur:
    """The point is blurred to a circle-of-confusion diameter.

    Attributes:
        diameter: output pixels, or a length of another kind (`OnSensor`, `OfHeight`).
        signed: when true the sign of `diameter` says on which side: positive for a point behind
            the focus, negative for one in front of it. Otherwise either side will do.
    """

    diameter: Diameter
    signed: bool = False

    def __post_init__(self) -> None:
        require_switches(signed=self.signed)
        _check_diameter("wished blur", self.diameter, negative=self.signed)


@dataclasses.dataclass(frozen=True)
class AtMost:
    """The point is blurred to at most a diameter: within it, it makes no difference.

    Attributes:
        diameter: output pixels, or a length of another kind (`OnSensor`, `OfHeight`).
    """

    diameter: Diameter

    def __post_init__(self) -> None:
        _check_diameter("largest wished blur", self.diameter, expected=_NO_NEGATIVE_LIMIT)


@dataclasses.dataclass(frozen=True)
class AtLeast:
    """The point is blurred to at least a diameter, on either side of the focus: "keep it unreadable".

    Attributes:
        diameter: output pixels, or a length of another kind (`OnSensor`, `OfHeight`).
    """

    diameter: Diameter

    def __post_init__(self) -> None:
        _check_diameter("smallest wished blur", self.diameter, expected=_NO_NEGATIVE_LIMIT)


@dataclasses.dataclass(frozen=True)
class SameBlur:
    """The point is blurred as much as another one.

    Attributes:
        other: name of the other focus point; of an object or a mask, its mean blur counts.
        same_side: whether both are to be on the same side of the focus; otherwise either will do.
    """

    other: str
    same_side: bool = False

    def __post_init__(self) -> None:
        require_switches(same_side=self.same_side)


@dataclasses.dataclass(frozen=True)
class ShownAt:
    """The place is shown at a position in the picture; of an object, the middle of its extent there.

    Shift and rise make it so, or the focal length where that is a zoom. The wish counts wherever its place is
    at first, unless that is behind the camera, and whether or not it is hidden.

    Attributes:
        x: pixels to the right of the frame's left edge.
        y: pixels below the frame's top edge.
    """

    x: SupportsFloat
    y: SupportsFloat

    def __post_init__(self) -> None:
        for each, axis in ((self.x, "x"), (self.y, "y")):
            number_or_traced(each, f"{axis} of the place to be shown at", "a number of pixels")
        if not all(isinstance(each, Tracer) or math.isfinite(each) for each in (self.x, self.y)):
            raise ValueError(f"the place to be shown at is ({self.x}, {self.y}); expected finite pixels")


@dataclasses.dataclass(frozen=True)
class InFrame:
    """All of the place, of an object all of its extent, is inside the frame; counts as `ShownAt` does.

    Attributes:
        margin: least distance to the frame's edges in output pixels, or a length of another kind.
    """

    margin: Diameter = 0.0

    def __post_init__(self) -> None:
        _check_range("the frame's margin is", amount(self.margin), MOST_AMOUNT)


Wish: TypeAlias = Sharp | Blur | AtMost | AtLeast | SameBlur | ShownAt | InFrame


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
        >>> FocusPoint(AtPixel(320, 200), Blur(30), name="lamp").weight
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
        _check_range(f"{label} has weight", weight, MOST_WEIGHT)
        _check_range(f"{label} has tolerance", amount(self.tolerance), MOST_AMOUNT)


def check_kind(what: str, value: object, kinds: Any) -> None:
    """Refuse a value that is none of a union's classes, for callers who do not check types."""
    if not isinstance(value, kinds):
        names = ", ".join(kind.__name__ for kind in get_args(kinds))
        raise ValueError(f"{what} {value!r}; expected one of {names}")


def _pixels(x: Any, y: Any, what: str) -> tuple[float, float]:
    """A position in the picture, finite or not."""
    return real_number(x, f"x of {what}", "a number of pixels"), real_number(
        y, f"y of {what}", "a number of pixels"
    )


def _check_range(what: str, value: Any, most: float) -> None:
    """Refuses a known number that is negative, too large, or none."""
    if not isinstance(value, Tracer) and not 0 <= value <= most:
        raise ValueError(f"{what} {value}; expected zero or a positive number of at most {most:g}")


def _check_samples(samples: int, what: str) -> None:
    require_counts(**{f"the number of samples of {what}": samples})


_NO_NEGATIVE = (
    "a diameter is not negative, unless the wish is signed to ask for a point in front of the focus"
)
_NO_NEGATIVE_LIMIT = "a limit is not negative, as it holds on both sides of the focus"


def _check_diameter(
    what: str, diameter: Diameter, *, negative: bool = False, expected: str = _NO_NEGATIVE
) -> None:
    value = amount(diameter)
    if isinstance(value, Tracer):
        return
    unit = "" if not isinstance(diameter, SupportsFloat) else " px"
    if not abs(value) <= MOST_AMOUNT:
        raise ValueError(f"{what} is {value}{unit}; expected a diameter of at most {MOST_AMOUNT:g}")
    if value < 0 and not negative:
        raise ValueError(f"{what} is {value}{unit}; {expected}")
