"""Diameters of blur in the units people think in: pixels, millimetres of film, shares of the picture."""

import dataclasses
from typing import Any, SupportsFloat, TypeAlias

from focusjax._arguments import number_or_traced
from focusjax.geometry import Camera


@dataclasses.dataclass(frozen=True)
class OnSensor:
    """A length on the sensor, such as the 0.03 mm of a customary circle of confusion.

    Attributes:
        millimetres: of the sensor whose width the camera has.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> wish = fj.FocusPoint(fj.AtPoint((0, 0, -2)), fj.Blur(fj.OnSensor(0.2)))
        >>> fj.locate([wish], camera).target.round(6).tolist()
        [2.0]
    """

    millimetres: SupportsFloat


@dataclasses.dataclass(frozen=True)
class OfHeight:
    """A share of the picture's height: the same look at every resolution.

    Attributes:
        fraction: 1 is the whole height.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=360, height=240, focal_length=0.05)
        >>> wish = fj.FocusPoint(fj.AtPoint((0, 0, -2)), fj.Blur(fj.OfHeight(0.01)))
        >>> fj.locate([wish], camera).target.round(6).tolist()
        [2.4]
    """

    fraction: SupportsFloat


Diameter: TypeAlias = SupportsFloat | OnSensor | OfHeight
"""Output pixels when a plain number."""


def amount(diameter: Diameter) -> Any:
    """The number in `diameter`, in its own unit: a float, or as it is where a JAX transformation traces it.

    Raises:
        ValueError: no number.
    """
    match diameter:
        case OnSensor(given) | OfHeight(given):
            pass
        case given:
            pass
    expected = "a number of pixels, such as 8.0, or OnSensor(millimetres) or OfHeight(fraction)"
    return number_or_traced(given, "a diameter", expected)


def pixels(diameter: Diameter, camera: Camera) -> Any:
    """`diameter` in output pixels of `camera`; see `amount` for its type.

    Example:
        >>> import jax.numpy as jnp
        >>> from focusjax.geometry import make_camera
        >>> camera = make_camera(jnp.eye(4), width=360, height=240, focal_length=0.05)
        >>> round(pixels(OnSensor(0.2), camera), 6), pixels(OfHeight(0.01), camera)
        (2.0, 2.4)
    """
    number = amount(diameter)
    if isinstance(diameter, OnSensor):
        return number / 1000 / float(camera.sensor_width) * camera.width
    if isinstance(diameter, OfHeight):
        return number * camera.height
    return number
