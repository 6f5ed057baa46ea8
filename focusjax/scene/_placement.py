"""Where an object stands: scale, rotation and translation as one matrix."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from focusjax._arguments import real_numbers


def placement(
    translate: Sequence[float], rotate: Sequence[float], scale: float | Sequence[float]
) -> Float[np.ndarray, "4 4"]:
    """The matrix world_from_object: scale first, then rotate, then translate.

    Args:
        translate: metres [3].
        rotate: degrees about the world's x, then y, then z axis [3], or an axis of any length
            followed by the degrees about it [4]; counter-clockwise seen against the axis.
        scale: one factor, or one for each axis; negative factors mirror.

    Raises:
        ValueError: a wrong number of values, one that is not finite, a scale or axis of zero.
    """
    shift = _numbers(translate, "translate", (3,))
    turn = _numbers(rotate, "rotate", (3, 4))
    factors = _numbers(scale if isinstance(scale, Sequence) else np.atleast_1d(scale), "scale", (1, 3))
    if (factors == 0.0).any():
        raise ValueError(f"scale is {scale}; expected factors other than 0, which would flatten the object")
    if len(turn) == 4:
        length = np.linalg.norm(turn[:3])
        if length == 0.0:
            raise ValueError(f"rotate is {list(rotate)}, whose axis is zero; expected an axis and degrees")
        rotation = _about(turn[:3] / length, turn[3])
    else:
        about_x, about_y, about_z = (_about(axis, angle) for axis, angle in zip(np.eye(3), turn, strict=True))
        rotation = about_z @ about_y @ about_x
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.broadcast_to(factors, (3,))
    matrix[:3, 3] = shift
    return matrix


def _about(axis: Float[np.ndarray, "3"], degrees: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about a unit `axis` by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.deg2rad(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _numbers(
    values: Sequence[float] | np.ndarray, what: str, lengths: tuple[int, ...]
) -> Float[np.ndarray, "n"]:
    """`values` as an array of one of the `lengths`."""
    expected = f"{' or '.join(str(length) for length in lengths)} finite numbers"
    array = real_numbers(values, what, expected)
    if array.ndim != 1 or len(array) not in lengths or not np.isfinite(array).all():
        raise ValueError(f"{what} is {values}; expected {expected}")
    return array
