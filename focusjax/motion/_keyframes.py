"""Values over time: keyframes, and what lies between them."""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import SupportsFloat

import numpy as np
from jaxtyping import Float

WAYS = ("smooth", "linear")
"""How values go from one keyframe to the next."""


@dataclasses.dataclass(frozen=True)
class Keyframes:
    """A number, or an array of numbers, that changes over the frames of a shot.

    Before the first keyframe and after the last the value is held. "smooth" eases out of the first and into
    the last one, is continuous in its first derivative, and, number by number, never leaves the range of
    the two keyframes around it (Fritsch and Carlson 1980); "linear" goes straight from one to the next.

    Attributes:
        frames: when, in frames; the shot's first frame is 1. Ascending, and not necessarily whole.
        values: what, in the order of `frames`.
        between: "smooth" or "linear".

    Example:
        >>> focal_length = keyframes({1: 0.035, 25: 0.085})
        >>> [round(float(focal_length(frame)), 3) for frame in (1, 13, 25, 40)]
        [0.035, 0.06, 0.085, 0.085]
    """

    frames: Float[np.ndarray, "k"]
    values: Float[np.ndarray, "k *shape"]
    between: str = "smooth"

    def __call__(self, frame: float) -> Float[np.ndarray, "*shape"]:
        """The value at a frame."""
        first, last = self.frames[0], self.frames[-1]
        if frame <= first or frame >= last:
            return np.asarray(self.values[0 if frame <= first else -1])
        if self.between == "linear":
            after = int(np.searchsorted(self.frames, frame))
            share = (frame - self.frames[after - 1]) / (self.frames[after] - self.frames[after - 1])
            return np.asarray(self.values[after - 1] + share * (self.values[after] - self.values[after - 1]))
        return np.asarray(_eased(self.frames, self.values)(frame))


def keyframes(
    keys: Mapping[float, SupportsFloat | Sequence[float] | np.ndarray], *, between: str = "smooth"
) -> Keyframes:
    """Keyframes from values by frame.

    Args:
        keys: at least one; frames in ascending order. All values have one shape.
        between: how values go from one keyframe to the next.

    Raises:
        ValueError: no keyframes, frames that are out of order, values that are not finite or of several
            shapes, or another way between them.
    """
    frames = check_frames(list(keys), between)
    arrays = [np.asarray(value, dtype=float) for value in keys.values()]
    if len({array.shape for array in arrays}) > 1:
        raise ValueError(
            f"keyframes have values of shapes {[array.shape for array in arrays]}; give all the same shape"
        )
    values = np.stack(arrays)
    for frame, value in zip(frames, values, strict=True):
        if not np.all(np.isfinite(value)):
            raise ValueError(f"the keyframe at frame {frame:g} is {value.tolist()}; expected finite numbers")
    return Keyframes(frames, values, between)


@dataclasses.dataclass(frozen=True)
class Turns:
    """A rotation that changes over the frames of a shot: the shortest way from one keyframe to the next.

    Between two keyframes it turns about one axis (Shoemake 1985). "smooth" keeps the angular speed
    continuous, and eases out of the first keyframe and into the last.

    Attributes:
        frames: when; ascending.
        rotations: what [k, 3, 3], rotation matrices.
        between: "smooth" or "linear".

    Example:
        >>> from scipy.spatial.transform import Rotation
        >>> pan = turns({1: np.eye(3), 25: Rotation.from_euler("y", 90, degrees=True).as_matrix()})
        >>> round(float(Rotation.from_matrix(pan(13)).magnitude()) * 180 / np.pi, 6)
        45.0
    """

    frames: Float[np.ndarray, "k"]
    rotations: Float[np.ndarray, "k 3 3"]
    between: str = "smooth"

    def __call__(self, frame: float) -> Float[np.ndarray, "3 3"]:
        """The rotation at a frame."""
        if frame <= self.frames[0] or frame >= self.frames[-1]:
            return self.rotations[0 if frame <= self.frames[0] else -1]
        from scipy.spatial.transform import Rotation

        after = int(np.clip(np.searchsorted(self.frames, frame), 1, len(self.frames) - 1))
        steps = np.einsum("kji,kjl->kil", self.rotations[:-1], self.rotations[1:])
        vectors = Rotation.from_matrix(steps).as_rotvec()
        angles = np.linalg.norm(vectors, axis=1)
        share = (frame - self.frames[after - 1]) / (self.frames[after] - self.frames[after - 1])
        if self.between == "smooth" and angles[after - 1] > 0:
            # The angle turned so far is eased, so that its speed has no jump at a keyframe.
            turned = np.concatenate([[0.0], np.cumsum(angles)])
            share = (float(_eased(self.frames, turned)(frame)) - turned[after - 1]) / angles[after - 1]
        step = Rotation.from_rotvec(share * vectors[after - 1]).as_matrix()
        return self.rotations[after - 1] @ step


def turns(keys: Mapping[float, np.ndarray], *, between: str = "smooth") -> Turns:
    """Turns from rotation matrices [3, 3] by frame.

    Args:
        keys: at least one; frames in ascending order.
        between: how the rotation goes from one keyframe to the next.

    Raises:
        ValueError: no keyframes, frames out of order, a matrix that is no rotation, or another way
            between them.
    """
    frames = check_frames(list(keys), between)
    rotations = np.stack([np.asarray(matrix, dtype=float) for matrix in keys.values()])
    for frame, matrix in zip(frames, rotations, strict=True):
        rigid = matrix.shape == (3, 3) and np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4)
        if not rigid or np.linalg.det(matrix) < 0:
            raise ValueError(
                f"the keyframe at frame {frame:g} is no rotation; remove scale, shear or mirroring"
            )
    return Turns(frames, rotations, between)


def check_frames(frames: Sequence[float], between: str) -> Float[np.ndarray, "k"]:
    """The frames of keyframes, as an array.

    Raises:
        ValueError: see `keyframes`.
    """
    if between not in WAYS:
        raise ValueError(f"between is {between!r}; expected 'smooth' or 'linear'")
    if not frames:
        raise ValueError("there are no keyframes; give at least one")
    array = np.asarray(frames, dtype=float)
    if not np.all(np.isfinite(array)):
        raise ValueError(f"keyframes are at frames {array.tolist()}; expected finite numbers")
    for earlier, later in itertools.pairwise(array):
        if not earlier < later:
            raise ValueError(
                f"the keyframe at frame {later:g} comes after the one at frame {earlier:g}; put them in"
                " ascending order, each frame once"
            )
    return array


def _eased(
    frames: Float[np.ndarray, "k"], values: Float[np.ndarray, "k *shape"]
) -> Callable[[float], np.ndarray]:
    """A monotone piecewise cubic that is level at both ends."""
    from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

    slopes = np.zeros_like(values)
    if len(frames) > 2:
        slopes[1:-1] = PchipInterpolator(frames, values, axis=0).derivative()(frames[1:-1])
    return CubicHermiteSpline(frames, values, slopes, axis=0)
