"""How far what a pinhole sees moves in the picture while the shutter is open."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from focusjax.geometry import Camera
from focusjax.layers import first_surfaces
from focusjax.scene import Scene
from focusjax.shutter._motion import Cameras, MovingWorld, StillWorld, cameras_of
from focusjax.shutter._shutter import Shutter

_FLAT = 1e-12
"""Square of the sine of a corner's angle, below which a triangle has no area."""
_HALVINGS = 8
"""Of the interval, for points that are behind the camera at an end of it."""


def middle_of(shutter: Shutter, *, frame: float, fps: float) -> float:
    """The middle, in frames, of the time that the shutter is open around a frame, for the middle row."""
    return frame + fps * (shutter.begin + shutter.open_time / 2.0)


def velocity_map(
    world: MovingWorld | Scene,
    camera: Camera | Callable[[float], Camera],
    shutter: Shutter,
    *,
    frame: float = 1.0,
    fps: float = 24.0,
) -> Float[np.ndarray, "h w 2"]:
    """Pixels (x right, y down) by which the first surface at every pixel centre moves during an exposure.

    A point of a triangle keeps its barycentric coordinates X = sum of b_i v_i, so that with P_t the camera at
    a time t its way is P_end(sum b_i v_i(end)) - P_begin(sum b_i v_i(begin)); the pixel centres are those of
    the middle of that time. Where nothing is seen, directions move as the camera turns and zooms. Of points
    that are behind the camera at either end the way is twice that of half the time, and so on.

    Args:
        world: what moves, or a scene that stands still before a moving camera.
        camera: where it is by frame, or one that stands still.
        shutter: when it is open; neither its curve nor how long it travels over the picture matters.
        frame: the instant around which it is, in frames.
        fps: frames of `world` and `camera` per second.

    Example:
        >>> velocity = velocity_map(moving, camera, make_shutter(1 / 50), frame=12)  # doctest: +SKIP
        >>> view = view_in_layers(layers, moving.at(12), velocity=velocity)  # doctest: +SKIP
    """
    moving = StillWorld(world) if isinstance(world, Scene) else world
    cameras = cameras_of(camera, frame)
    middle, half = middle_of(shutter, frame=frame, fps=fps), fps * shutter.open_time / 2.0
    scene, seen_by = moving.at(middle), cameras.at(middle)
    disparity, face = (found.ravel() for found in first_surfaces(scene, seen_by))
    rows, columns = np.divmod(np.arange(len(face)), seen_by.width)
    towards = _directions(seen_by, np.stack([columns, rows], axis=-1) + 0.5)
    velocity = np.zeros((len(face), 2))
    far = face < 0
    velocity[far] = _turned(cameras, towards[far], middle - half, middle + half)
    left = np.flatnonzero(~far)
    corners = scene.faces[face[left]]
    position = np.asarray(seen_by.position, dtype=np.float64)
    points = position + towards[left] / disparity[left, None]
    weights = _barycentric(scene.vertices[corners], points)
    for halving in range(_HALVINGS):
        part = half / 2.0**halving
        (start, before), (end, after) = (
            _projected(cameras.at(time), np.einsum("nk,nkx->nx", weights, moving.at(time).vertices[corners]))
            for time in (middle - part, middle + part)
        )
        there = before & after
        velocity[left[there]] = 2.0**halving * (end - start)[there]
        left, corners, weights = (values[~there] for values in (left, corners, weights))
        if not len(left):
            break
    return velocity.reshape(seen_by.height, seen_by.width, 2)


def _directions(camera: Camera, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """World directions through pixel positions, scaled as `Camera.direction` has them."""
    slope = (xy - np.asarray(camera.principal_point)) / float(camera.focal_px)
    towards = np.stack([slope[:, 0], -slope[:, 1], -np.ones(len(xy))], axis=-1)
    return towards @ np.asarray(camera.world_from_camera, dtype=np.float64)[:3, :3].T


def _projected(
    camera: Camera, points: Float[np.ndarray, "n 3"], *, far: bool = False
) -> tuple[Float[np.ndarray, "n 2"], np.ndarray]:
    """Where points, or `far` directions, are in the picture, and whether they are before the lens."""
    pose = np.asarray(camera.world_from_camera, dtype=np.float64)
    x, y, z = ((points if far else points - pose[:3, 3]) @ pose[:3, :3]).T
    ahead = z < 0
    depth = np.where(ahead, -z, 1.0)
    offset = float(camera.focal_px) * np.stack([x, -y], axis=-1) / depth[:, None]
    return np.asarray(camera.principal_point, dtype=np.float64) + offset, ahead


def _turned(
    cameras: Cameras, towards: Float[np.ndarray, "n 3"], begin: float, end: float
) -> Float[np.ndarray, "n 2"]:
    """The way of directions; 0 where they are not before the camera at both ends."""
    (start, before), (stop, after) = (
        _projected(cameras.at(time), towards, far=True) for time in (begin, end)
    )
    return np.where((before & after)[:, None], stop - start, 0.0)


def _barycentric(
    corners: Float[np.ndarray, "n 3 3"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Weights of the corners of triangles for points in their planes; the middle of those without area."""
    edges, offset = corners[:, 1:] - corners[:, :1], points - corners[:, 0]
    a, b, c = (np.einsum("nx,nx->n", edges[:, i], edges[:, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    d, e = (np.einsum("nx,nx->n", edges[:, i], offset) for i in (0, 1))
    area = a * c - b * b
    flat = area <= _FLAT * a * c
    area = np.where(flat, 1.0, area)
    second, third = (np.where(flat, 1.0 / 3.0, value / area) for value in (c * d - b * e, a * e - b * d))
    return np.stack([1.0 - second - third, second, third], axis=-1)
