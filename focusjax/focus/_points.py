"""What a person asks for: a place in the scene, and how sharp or blurred it should be."""

import dataclasses
import math
from collections.abc import Sequence
from typing import SupportsFloat, SupportsIndex, TypeAlias

import numpy as np
from jaxtyping import Array

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
        if self.samples < 1:
            raise ValueError(f"object {self.name!r} has {self.samples} samples; expected at least 1")


Attachment: TypeAlias = AtPixel | AtPoint | AtInfinity | OnTriangle | OnObject


@dataclasses.dataclass(frozen=True)
class Sharp:
    """The point is in focus: its blur diameter is 0 px."""


@dataclasses.dataclass(frozen=True)
class Blur:
    """The point is blurred to a circle-of-confusion diameter.

    Attributes:
        pixels: diameter in output pixels.
        signed: when true the sign of `pixels` says on which side: positive for a point behind
            the focus, negative for one in front of it. Otherwise either side will do.
    """

    pixels: SupportsFloat
    signed: bool = False

    def __post_init__(self) -> None:
        pixels = float(self.pixels)
        if not math.isfinite(pixels):
            raise ValueError(f"wished blur is {pixels} px; expected a finite diameter")
        if pixels < 0 and not self.signed:
            raise ValueError(
                f"wished blur is {pixels} px; a diameter is not negative, unless the wish is signed to"
                " ask for a point in front of the focus"
            )


Wish: TypeAlias = Sharp | Blur


@dataclasses.dataclass(frozen=True)
class FocusPoint:
    """One wish about one place.

    A wish adds weight x (error in pixels)^2 to what the solve minimises.

    Attributes:
        where: the place.
        wish: sharp, or a blur diameter.
        weight: importance; 0 reports the point without letting it count.
        tolerance: error in pixels up to which the wish is called met.
        name: how reports call the wish; "point 1", "point 2", ... in order when empty.

    Example:
        >>> FocusPoint(AtPixel(320, 200), Blur(30), name="lamp").weight
        1.0
    """

    where: Attachment
    wish: Wish
    weight: SupportsFloat = 1.0
    tolerance: SupportsFloat = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        label = f"focus point {self.name!r}" if self.name else "a focus point"
        for what, value in (("weight", float(self.weight)), ("tolerance", float(self.tolerance))):
            if not 0 <= value < math.inf:
                raise ValueError(f"{label} has {what} {value}; expected zero or a positive finite number")
