"""What moves while the shutter is open: bodies of a scene over time, how far, and where they may be seen."""

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.scene import Scene

NODES = 33
"""Times of the shutter's interval at which motion is looked at."""
_STILL = 1e-9
"""Change, relative to what changes, below which nothing moves."""
_BESIDE_PX = 3.0
"""Around what moves: silhouettes between samples, and paths that are not straight between two times."""


@dataclasses.dataclass(frozen=True)
class Body:
    """Faces of a scene that move together.

    Attributes:
        name: how messages call it.
        faces: numbers of its faces.
        placed: the matrix [4, 4] that takes it from any one pose to the world at a time, rigid or any other
            affine map; None for what deforms.
    """

    name: str
    faces: range
    placed: Callable[[float], Float[np.ndarray, "4 4"]] | None = None


@runtime_checkable
class MovingWorld(Protocol):
    """A scene of which parts move: `focusjax.shot.MovingScene`, for one."""

    def at(self, frame: float) -> Scene:
        """The scene at a time: always the same faces, in the same order."""
        ...

    def bodies(self) -> tuple[Body, ...]:
        """What may move; all other faces stand still."""
        ...


@dataclasses.dataclass(frozen=True)
class StillWorld:
    """A scene in which nothing moves, for cameras that do."""

    scene: Scene

    def at(self, frame: float) -> Scene:
        """The scene."""
        return self.scene

    def bodies(self) -> tuple[Body, ...]:
        """None."""
        return ()


@dataclasses.dataclass(frozen=True)
class Cameras:
    """The camera over time; lens rays are made in the axes of the one of the frame, `still`."""

    at: Callable[[float], Camera]
    still: Camera

    def world_from_rays(self, time: float) -> Float[np.ndarray, "4 4"]:
        """From the axes in which the lens makes its rays to the world, at a time.

        Of a camera that zooms, slopes are divided by as much as its focal length grows. (So is where rays
        cross the lens, which the f-number would have grow: blur is off by the share by which the camera zooms
        meanwhile.)
        """
        camera = self.at(time)
        pose = np.asarray(camera.world_from_camera, dtype=np.float64).copy()
        pose[:3, :2] *= float(self.still.focal_px) / float(camera.focal_px)
        return pose

    def move(self, times: Float[np.ndarray, " m"]) -> bool:
        """Whether it is elsewhere at some of the times."""
        return not _alike(np.stack([self.world_from_rays(float(time)) for time in times]))


def cameras_of(camera: Camera | Callable[[float], Camera], frame: float) -> Cameras:
    """A camera by frame, or one that stands still, around a frame.

    Raises:
        ValueError, by `at`: a camera that changes its number of pixels.
    """
    if isinstance(camera, Camera):
        return Cameras(lambda _: camera, camera)
    still = camera(frame)

    def at(time: float) -> Camera:
        found = camera(time)
        if (found.width, found.height) != (still.width, still.height):
            raise ValueError(
                f"the camera has {found.width} x {found.height} pixels at frame {time:g} and {still.width} x"
                f" {still.height} at frame {frame:g}; give it as many all the time"
            )
        return found

    return Cameras(at, still)


def body_poses(body: Body, times: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 4 4"]:
    """World from the body at some times; the identity for what deforms."""
    if body.placed is None:
        return np.broadcast_to(np.eye(4), (len(times), 4, 4))
    return np.stack([np.asarray(body.placed(float(time)), dtype=np.float64) for time in times])


def bodies_that_move(world: MovingWorld, times: Float[np.ndarray, " m"]) -> tuple[Body, ...]:
    """Those of the world that are elsewhere, or other, at some of the times."""
    found = []
    for body in world.bodies():
        if body.placed is not None:
            moves = not _alike(body_poses(body, times))
        else:
            moves = not _alike(np.stack([_corners(world.at(float(time)), body) for time in times]))
        if moves:
            found.append(body)
    return tuple(found)


@dataclasses.dataclass(frozen=True)
class Track:
    """Where a body's vertices are in the picture at some times, in axes of the frame's camera and lens.

    Attributes:
        xy: pixels [m, v, 2].
        disparity: 1/m [m, v]; 0 and less behind the lens.
        faces: vertex numbers [t, 3].
    """

    xy: Float[np.ndarray, "m v 2"]
    disparity: Float[np.ndarray, "m v"]
    faces: Int[np.ndarray, "t 3"]


def track(world: MovingWorld, body: Body, cameras: Cameras, times: Float[np.ndarray, " m"]) -> Track:
    """The track of a body's vertices."""
    scene = world.at(float(times[0]))
    used, faces = np.unique(scene.faces[body.faces.start : body.faces.stop], return_inverse=True)
    poses = body_poses(body, times)
    start = np.linalg.inv(poses[0])
    points = []
    for number, time in enumerate(times):
        vertices = scene.vertices[used] if body.placed is not None else world.at(float(time)).vertices[used]
        matrix = np.linalg.inv(cameras.world_from_rays(float(time))) @ poses[number] @ start
        points.append(vertices @ matrix[:3, :3].T + matrix[:3, 3])
    x, y, z = np.moveaxis(np.stack(points), -1, 0)
    safe = np.where(z < 0, -z, 1.0)
    focal = float(cameras.still.focal_px)
    centre = np.asarray(cameras.still.principal_point, dtype=np.float64)
    xy = centre + focal * np.stack([x / safe, -y / safe], axis=-1)
    return Track(xy, np.where(z < 0, 1.0 / safe, 0.0), faces.reshape(-1, 3))


def pixels_that_change(
    track: Track, camera: Camera, lens: AbstractLens, near: float
) -> Bool[np.ndarray, "h w"]:
    """Pixels with rays that may meet a body on its way.

    Between two times each triangle is taken to stay in the box around both of its places.
    """
    rows, columns = camera.height + 1, camera.width + 1
    change = np.zeros(rows * columns)
    reach = _at_vertices(_reaches, track, camera, lens)
    for k in range(len(track.xy) - 1):
        ends = slice(k, k + 2)
        there = (track.disparity[ends].min(axis=0) > 0)[track.faces]
        # What is cut by the near plane may be anywhere.
        cut = there.any(axis=1) & ~there.all(axis=1)
        if cut.any() or track.disparity[ends].max(initial=0.0) > 1.0 / near:
            return np.ones((camera.height, camera.width), dtype=bool)
        low, high = _boxes(track, k, reach[ends].max(axis=0) + _BESIDE_PX, there.all(axis=1))
        size = np.array([camera.width, camera.height])
        left, top = np.clip(np.floor(low), 0, size).astype(np.intp).T
        right, bottom = np.clip(np.ceil(high), 0, size).astype(np.intp).T
        for row, column, sign in ((top, left, 1), (bottom, right, 1), (top, right, -1), (bottom, left, -1)):
            change += sign * np.bincount(row * columns + column, minlength=rows * columns)
    return change.reshape(rows, columns).cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0.5


def _boxes(
    track: Track, k: int, beyond: Float[np.ndarray, " v"], faces: Bool[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, "s 2"], Float[np.ndarray, "s 2"]]:
    """Corners of boxes around some faces at one time and the next, each vertex with what is `beyond` it.

    Rays reach less far from points within a face than from its vertices, as reach is convex.
    """
    low = np.minimum(track.xy[k], track.xy[k + 1]) - beyond[:, None]
    high = np.maximum(track.xy[k], track.xy[k + 1]) + beyond[:, None]
    a, b, c = track.faces[faces].T
    return np.minimum(np.minimum(low[a], low[b]), low[c]), np.maximum(np.maximum(high[a], high[b]), high[c])


def steps_in_pixels(track: Track, camera: Camera, lens: AbstractLens) -> tuple[float, float]:
    """How far a body moves in the picture at most, as it is and weighed by its blur.

    From the first time to the last, as if it always moved as it does at its fastest. Weighed, the motion of
    what is blurred over d pixels counts max(1, d / 2) times less: disks that lie half of their diameter apart
    leave a ripple of 7 %.
    """
    blur = _at_vertices(_blurs, track, camera, lens)
    wide, size = np.abs(blur), np.array([camera.width, camera.height])
    plain = weighed = 0.0
    for k in range(len(track.xy) - 1):
        ends = slice(k, k + 2)
        there = (track.disparity[ends].min(axis=0) > 0)[track.faces].all(axis=1)
        low, high = _boxes(track, k, wide[ends].max(axis=0), there)
        inside = ((high > 0) & (low < size)).all(axis=1)
        seen = np.zeros(track.disparity.shape[1], dtype=bool)
        seen[track.faces[there][inside]] = True
        step = np.linalg.norm(track.xy[k + 1, seen] - track.xy[k, seen], axis=-1)
        # Through the focal plane it is sharp in between.
        same = np.sign(blur[k, seen]) == np.sign(blur[k + 1, seen])
        least = np.where(same, wide[ends][:, seen].min(axis=0), 0.0)
        plain = max(plain, float(step.max(initial=0.0)))
        weighed = max(weighed, float((step / np.maximum(1.0, 0.5 * least)).max(initial=0.0)))
    return (len(track.xy) - 1) * plain, (len(track.xy) - 1) * weighed


def _corners(scene: Scene, body: Body) -> np.ndarray:
    return scene.vertices[np.unique(scene.faces[body.faces.start : body.faces.stop])]


def _alike(values: np.ndarray) -> bool:
    size = np.abs(values).max(initial=0.0)
    return bool(np.abs(values - values[:1]).max(initial=0.0) <= _STILL * size)


def _at_vertices(
    what: Callable[[AbstractLens, Camera, Array], Array], track: Track, camera: Camera, lens: AbstractLens
) -> Float[np.ndarray, "m v"]:
    """What a lens does at the disparities of a track."""
    flat = jnp.asarray(track.disparity.reshape(-1), dtype=camera.focal_px.dtype)
    return np.asarray(what(lens, camera, flat), dtype=np.float64).reshape(track.disparity.shape)


@jit
def _reaches(lens: AbstractLens, camera: Camera, disparity: Float[Array, " n"]) -> Float[Array, " n"]:
    return jax.vmap(lambda w: lens.reach(camera, w))(disparity)


@jit
def _blurs(lens: AbstractLens, camera: Camera, disparity: Float[Array, " n"]) -> Float[Array, " n"]:
    return jax.vmap(lambda w: lens.blur(camera, camera.principal_point, w))(disparity)
