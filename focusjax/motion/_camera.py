"""A camera that moves: poses and focal lengths by frame."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from focusjax.geometry import Camera, look_at, make_camera
from focusjax.motion._keyframes import Keyframes, keyframes, turns

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

    def pose(frame: float) -> Float[np.ndarray, "4 4"]:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn(frame), place(frame)
        return matrix

    return pose


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
    if (pose is None) == (position is None and target is None) or (position is None) != (target is None):
        raise ValueError("give either a pose, or both position and target")
    known: dict[tuple[Any, ...], Camera] = {}
    sizes = {"focal_length": focal_length, **size}

    def placed(frame: float) -> Float[np.ndarray, "*rows"]:
        if pose is not None:
            return pose(frame)
        assert position is not None
        assert target is not None
        return np.stack([position(frame), target(frame)])

    def depth(frame: float) -> float:
        """How far ahead the point is whose size is kept, in metres."""
        assert keep_size_at is not None
        point, here = np.asarray(keep_size_at(frame), dtype=float), placed(frame)
        if pose is not None:
            ahead = float((point - here[:3, 3]) @ -here[:3, 2])
        else:
            axis = here[1] - here[0]
            length = np.linalg.norm(axis)
            ahead = float((point - here[0]) @ axis / length) if length > 0 else 0.0
        if not ahead > 0:
            raise ValueError(
                f"frame {frame:g}: the point [{', '.join(f'{x:g}' for x in point)}] is behind the camera, so"
                " that it has no size to keep; move the camera, or give another point"
            )
        return ahead

    first: list[float] = []

    def at(frame: float) -> Camera:
        values: dict[str, Any] = {
            name: float(value(frame)) if isinstance(value, Keyframes) else value
            for name, value in sizes.items()
        }
        if keep_size_at is not None:
            if not first:
                first.append(depth(1.0))
            values["focal_length"] *= depth(frame) / first[0]
        here = placed(frame)
        # A camera that stands still is one camera: what is known of one frame serves the others.
        key = (*values.values(), here.tobytes())
        if key not in known:
            try:
                known[key] = (
                    make_camera(here, **values)
                    if pose is not None
                    else look_at(here[0], here[1], up, **values)
                )
            except ValueError as error:
                raise ValueError(f"frame {frame:g}: {error}") from None
        return known[key]

    return at


def solved_path(path: Path, frame: float, camera: Camera) -> Path:
    """`path` with what was solved for, such as a shift, as `camera` has it at a frame.

    Args:
        path: the camera over time before solving.
        frame: when `camera` is the camera.
        camera: solved.
    """
    first = path(frame)

    def at(time: float) -> Camera:
        then = path(time)
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
