"""A camera that moves: poses and focal lengths by frame."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.geometry import Camera, look_at, make_camera
from focusjax.motion._keyframes import Keyframes, Turns, keyframes, turns

Pose = Callable[[float], Float[np.ndarray, "4 4"]]
"""The matrix world_from_camera at a frame."""


def pose_path(keys: Mapping[float, np.ndarray], *, between: str = "smooth") -> Pose:
    """A pose between keyframes: positions number by number, rotations by the shortest turn.

    Args:
        keys: rigid matrices world_from_camera [4, 4] by frame, in ascending order.
        between: how the pose goes from one keyframe to the next.

    Raises:
        ValueError: as `keyframes` and `turns`.

    Example:
        >>> dolly = pose_path({1: np.eye(4), 25: np.diag([1.0, 1, 1, 1]) + np.eye(4, k=3) * 2})
        >>> dolly(13)[0, 3]
        np.float64(1.0)
    """
    matrices = {frame: np.asarray(matrix, dtype=float) for frame, matrix in keys.items()}
    for frame, matrix in matrices.items():
        if matrix.shape != (4, 4):
            raise ValueError(
                f"the pose at frame {frame:g} has shape {matrix.shape}; expected 4 rows of 4 numbers"
            )
    place = keyframes({frame: matrix[:3, 3] for frame, matrix in matrices.items()}, between=between)
    turn = turns({frame: matrix[:3, :3] for frame, matrix in matrices.items()}, between=between)

    return _PosePath(place, turn)


@dataclasses.dataclass(frozen=True)
class _PosePath:
    """Goes to other processes by pickle, as functions within functions do not."""

    place: Keyframes
    turn: Turns

    def __call__(self, frame: float) -> Float[np.ndarray, "4 4"]:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.turn(frame), self.place(frame)
        return matrix


Path = Callable[[float], Camera]
"""The camera at a frame, and between frames."""


def moving_camera(
    *,
    focal_length: float | Keyframes,
    pose: Pose | None = None,
    position: Keyframes | None = None,
    target: Keyframes | None = None,
    up: Sequence[float] = (0.0, 1.0, 0.0),
    keep_size_at: Callable[[float], Float[np.ndarray, "3"]] | None = None,
    **size: Any,
) -> Path:
    """The camera at any frame, whole or not; arguments are those of `camera_path`.

    With `keep_size_at`, a point in world metres by frame, the focal length is `focal_length` in frame 1 and
    grows with the point's depth, so that what is there keeps its size in the picture.

    Raises:
        ValueError: not one full pose; and, when a frame is asked for, as `make_camera` or `look_at`, or where
            the point that is to keep its size is behind the camera.
    """
    if pose is not None and position is None and target is None:
        placed = pose
    elif pose is None and position is not None and target is not None:
        placed = _Looking(position, target)
    else:
        raise ValueError("give either a pose, or both position and target")
    return _MovingCamera({"focal_length": focal_length, **size}, placed, tuple(up), keep_size_at)


@dataclasses.dataclass(frozen=True)
class _Looking:
    """Where a camera is and what it looks at: two points by frame."""

    position: Keyframes
    target: Keyframes

    def __call__(self, frame: float) -> Float[np.ndarray, "2 3"]:
        return np.stack([self.position(frame), self.target(frame)])


@dataclasses.dataclass(frozen=True)
class _MovingCamera:
    """See `moving_camera`."""

    sizes: Mapping[str, Any]
    placed: Pose | _Looking
    up: tuple[float, ...]
    keep_size_at: Callable[[float], Float[np.ndarray, "3"]] | None
    _known: dict[tuple[Any, ...], Camera] = dataclasses.field(default_factory=dict, init=False, repr=False)

    def __call__(self, frame: float) -> Camera:
        values: dict[str, Any] = {
            name: float(value(frame)) if isinstance(value, Keyframes) else value
            for name, value in self.sizes.items()
        }
        if self.keep_size_at is not None:
            values["focal_length"] *= self._depth(frame) / self._first_depth
        here = self.placed(frame)
        # A camera that stands still is one camera: what is known of one frame serves the others.
        key = (*values.values(), here.tobytes())
        if key not in self._known:
            try:
                self._known[key] = (
                    look_at(here[0], here[1], self.up, **values)
                    if isinstance(self.placed, _Looking)
                    else make_camera(here, **values)
                )
            except ValueError as error:
                raise ValueError(f"frame {frame:g}: {error}") from None
        return self._known[key]

    @cached_property
    def _first_depth(self) -> float:
        return self._depth(1.0)

    def _depth(self, frame: float) -> float:
        """How far ahead the point is whose size is kept, in metres."""
        assert self.keep_size_at is not None
        point, here = np.asarray(self.keep_size_at(frame), dtype=float), self.placed(frame)
        if isinstance(self.placed, _Looking):
            axis = here[1] - here[0]
            length = np.linalg.norm(axis)
            ahead = float((point - here[0]) @ axis / length) if length > 0 else 0.0
        else:
            ahead = float((point - here[:3, 3]) @ -here[:3, 2])
        if not ahead > 0:
            raise ValueError(
                f"frame {frame:g}: the point [{', '.join(f'{x:g}' for x in point)}] is behind the camera, so"
                " that it has no size to keep; move the camera, or give another point"
            )
        return ahead


def solved_path(path: Path, frame: float, camera: Camera, *, breathes: bool = False) -> Path:
    """`path` with what was solved for, such as a shift, as `camera` has it at a frame.

    Args:
        path: the camera over time before solving.
        frame: when `camera` is the camera.
        camera: solved.
        breathes: whether its focal length is the image distance s of a lens of the path's focal length F that
            is focused at 1/F - 1/s, and so it is while the lens zooms; otherwise the two stay in proportion.
    """
    first = path(frame)

    def at(time: float) -> Camera:
        then = path(time)
        if breathes:
            nearness = 1.0 / first.focal_length - 1.0 / camera.focal_length
            if not nearness * then.focal_length < 1.0:
                raise ValueError(
                    f"at time {time:g} the focal length of {1000 * float(then.focal_length):.4g} mm reaches"
                    f" the focus distance, {1000 / float(nearness):.4g} mm, where no lens forms a real image;"
                    " zoom less, or focus farther away"
                )
            length = 1.0 / (1.0 / then.focal_length - nearness)
        else:
            length = camera.focal_length * (then.focal_length / first.focal_length)
        return dataclasses.replace(camera, world_from_camera=then.world_from_camera, focal_length=length)

    return at


def camera_path(
    frames: int,
    *,
    focal_length: float | Keyframes,
    pose: Pose | None = None,
    position: Keyframes | None = None,
    target: Keyframes | None = None,
    up: Sequence[float] = (0.0, 1.0, 0.0),
    **size: Any,
) -> tuple[Camera, ...]:
    """The cameras of a shot, one a frame.

    Args:
        frames: how many; the first is frame 1.
        focal_length: metres.
        pose: world_from_camera by frame; give this, or `position` and `target`.
        position: of the camera, in world metres.
        target: a point on the view axis, in world metres, which stays in the middle while both move.
        up: world direction that is up in the picture, with `target`.
        size: width, height, sensor_width, shift and rise, as for `make_camera`; the last three may be
            keyframes.

    Raises:
        ValueError: not one full pose, or a value that `make_camera` or `look_at` refuses, with the frame.

    Example:
        >>> orbit = keyframes({1: (0, 0, 2), 25: (2, 0, 0)})
        >>> still = keyframes({1: (0, 0, 0)})
        >>> cameras = camera_path(25, focal_length=0.05, position=orbit, target=still, width=64, height=48)
        >>> cameras[24].position.tolist()
        [2.0, 0.0, 0.0]
    """
    at = moving_camera(focal_length=focal_length, pose=pose, position=position, target=target, up=up, **size)
    return tuple(at(frame) for frame in range(1, frames + 1))
