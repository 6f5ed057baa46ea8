"""What is wished of a place: how sharp or blurred it is, or where it is shown.

Diameters, margins and places in the picture may be traced by `jax.jit` and `jax.grad`; what is traced is
checked when the compiled solve runs.
"""

import dataclasses
import math
from typing import Any, SupportsFloat, TypeAlias

from jax.core import Tracer

from focusjax._arguments import number_or_traced, require_switches
from focusjax.focus._units import Diameter, amount

MOST_AMOUNT = 1e6
"""Largest diameter, margin or tolerance, in its own unit: no picture has as many pixels in a row."""


@dataclasses.dataclass(frozen=True)
class Sharp:
    """The point is in focus: its blur diameter is 0.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> start = fj.thin_lens(focus_distance=5, f_number=2, focal_length=0.05)
        >>> points = fj.locate([fj.FocusPoint(fj.AtPoint((0, 0, -2)), fj.Sharp())], camera)
        >>> round(float(fj.solve(points, camera, start).lens.focus_distance()), 4)
        2.0
    """


@dataclasses.dataclass(frozen=True)
class Blur:
    """The point is blurred to a circle-of-confusion diameter.

    Attributes:
        diameter: output pixels, or a length of another kind (`OnSensor`, `OfHeight`).
        signed: when true the sign of `diameter` says on which side: positive for a point behind
            the focus, negative for one in front of it. Otherwise either side will do.

    Example:
        A lens of 50 mm at f/2, focused on 2 m, blurs what is 4 m away by 3.125 of these pixels.

        >>> from focusjax.focus import errors
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> points = fj.locate([fj.FocusPoint(fj.AtPoint((0, 0, -4)), fj.Blur(3))], camera)
        >>> errors(points, camera, lens).round(4).tolist()
        [0.125]
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

    Example:
        A lens of 50 mm at f/2, focused on 2 m, blurs what is 4 m away by 3.125 of these pixels.

        >>> from focusjax.focus import errors
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> wishes = [fj.FocusPoint(fj.AtPoint((0, 0, -4)), fj.AtMost(most)) for most in (3, 4)]
        >>> errors(fj.locate(wishes, camera), camera, lens).round(4).tolist()
        [0.125, 0.0]
    """

    diameter: Diameter

    def __post_init__(self) -> None:
        _check_diameter("largest wished blur", self.diameter, expected=_NO_NEGATIVE_LIMIT)


@dataclasses.dataclass(frozen=True)
class AtLeast:
    """The point is blurred to at least a diameter, on either side of the focus: "keep it unreadable".

    Attributes:
        diameter: output pixels, or a length of another kind (`OnSensor`, `OfHeight`).

    Example:
        A lens of 50 mm at f/2, focused on 2 m, blurs what is 4 m away by 3.125 of these pixels.

        >>> from focusjax.focus import errors
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> wishes = [fj.FocusPoint(fj.AtPoint((0, 0, -4)), fj.AtLeast(least)) for least in (3, 4)]
        >>> errors(fj.locate(wishes, camera), camera, lens).round(4).tolist()
        [0.0, -0.875]
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

    Example:
        Points at 1 m and 3 m, or 1 and 1/3 dioptres, are equally blurred with the focus on 2/3 dioptres.

        >>> from focusjax.focus import errors
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=1.5, f_number=2, focal_length=0.05)
        >>> near = fj.FocusPoint(fj.AtPoint((0, 0, -1)), fj.AtMost(5), name="near")
        >>> far = fj.FocusPoint(fj.AtPoint((0, 0, -3)), fj.SameBlur("near"), name="far")
        >>> abs(errors(fj.locate([near, far], camera), camera, lens)[1].round(4)).tolist()
        0.0
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

    Example:
        The place is seen 25 pixels to the right of the middle; it is wished in the middle, 20 pixels up.

        >>> from focusjax.focus import errors
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> points = fj.locate([fj.FocusPoint(fj.AtPoint((0.1, 0, -2)), fj.ShownAt(180, 100))], camera)
        >>> errors(points, camera, lens).round(4).tolist()
        [25.0, 20.0]
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

    Example:
        The place is seen at x = 355, so that it is 5 pixels from the right edge.

        >>> from focusjax.focus import errors
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> points = fj.locate([fj.FocusPoint(fj.AtPoint((0.7, 0, -2)), fj.InFrame(margin=10))], camera)
        >>> round(float(errors(points, camera, lens).max()), 4)
        5.0
    """

    margin: Diameter = 0.0

    def __post_init__(self) -> None:
        check_range("the frame's margin is", amount(self.margin), MOST_AMOUNT)


Wish: TypeAlias = Sharp | Blur | AtMost | AtLeast | SameBlur | ShownAt | InFrame


def check_range(what: str, value: Any, most: float) -> None:
    """Refuses a known number that is negative, too large, or none."""
    if not isinstance(value, Tracer) and not 0 <= value <= most:
        raise ValueError(f"{what} {value}; expected zero or a positive number of at most {most:g}")


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
