"""A camera and a scene as files have them, in focusjax's units and axes."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from focusjax._words import did_you_mean, listed
from focusjax.scene import AbstractLight, SceneObject

_SKEWED = 1e-4
"""Cosine between two axes of a pose above which they are not at right angles."""


class SceneFileError(ValueError):
    """A file of a scene or camera that cannot be used; the message names the file and what to do.

    Example:
        >>> fj.read_camera("shot.usda")
        Traceback (most recent call last):
        focusjax.scene_files._stored.SceneFileError: shot.usda: does not exist; check the path
    """


@dataclasses.dataclass(frozen=True)
class Opening:
    """The shape of an aperture.

    Attributes:
        blades: how many; 0 for a disk.
        rotation: of the first corner, in radians, as `polygon` takes it.
        roundness: 0 for straight sides to 1 for a disk.
        squeeze: of an anamorphic lens, as `polygon` takes it.
    """

    blades: int = 0
    rotation: float = 0.0
    roundness: float = 0.0
    squeeze: float = 1.0


@dataclasses.dataclass(frozen=True)
class StoredCamera:
    """A camera with what its file says of the lens; None where it says nothing.

    Attributes:
        name: in the file.
        pose: rigid transform world_from_camera [4, 4], metres; +y is up, the camera looks along its -z axis.
        field_of_view: from top to bottom in radians; None where focal length and sensor are known.
        focal_length: in metres.
        sensor_width: in metres.
        shift: how far in metres the lens slides to the right over the sensor.
        rise: the same, up.
        resolution: width and height in pixels.
        focus_distance: in metres along the view axis.
        f_number: 0 for a pinhole.
        tilt: of the lens in radians.
        swing: of the lens in radians.
        opening: its shape, where focusjax wrote the file.
    """

    name: str
    pose: Float[np.ndarray, "4 4"]
    field_of_view: float | None = None
    focal_length: float | None = None
    sensor_width: float | None = None
    shift: float = 0.0
    rise: float = 0.0
    resolution: tuple[int, int] | None = None
    focus_distance: float | None = None
    f_number: float | None = None
    tilt: float = 0.0
    swing: float = 0.0
    opening: Opening | None = None


@dataclasses.dataclass(frozen=True)
class CameraFrames:
    """A camera in all frames of its file.

    Attributes:
        cameras: one for each frame.
        fps: frames per second.
    """

    cameras: tuple[StoredCamera, ...]
    fps: float


@dataclasses.dataclass(frozen=True)
class StoredScene:
    """Meshes and lights of a file.

    Attributes:
        objects: one for each mesh, by its name in the file, where it stands in the first frame.
        lights: directional and point lights.
        ambient: light from everywhere [3], of a dome of one colour.
        background: what is seen at infinity [3]; None where the file says nothing.
        motions: of objects that move, by name: world_from_mesh [frames, 4, 4], metres from the file's units.
        frames: how many there are; 1 where nothing says so.
        fps: frames per second.
    """

    objects: tuple[SceneObject, ...]
    lights: tuple[AbstractLight, ...] = ()
    ambient: Float[np.ndarray, "3"] = dataclasses.field(default_factory=lambda: np.zeros(3))
    background: Float[np.ndarray, "3"] | None = None
    motions: Mapping[str, Float[np.ndarray, "_ 4 4"]] = dataclasses.field(default_factory=dict)
    frames: int = 1
    fps: float = 24.0


def rigid(matrix: Float[np.ndarray, "4 4"], path: Path, name: str) -> Float[np.ndarray, "4 4"]:
    """The pose of a camera's transform, whose scale does not matter to a camera.

    Raises:
        SceneFileError: numbers that are not finite, a mirrored or skewed transform, or one of no extent.
    """
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not np.isfinite(matrix).all() or not (lengths > 0).all():
        raise SceneFileError(f"{path}: the transform of camera {name!r} has no inverse; place it anew")
    axes = matrix[:3, :3] / lengths
    if np.abs(axes.T @ axes - np.eye(3)).max() > _SKEWED or np.linalg.det(axes) < 0:
        raise SceneFileError(
            f"{path}: the transform of camera {name!r} is skewed or mirrored; apply the scale of its parents"
        )
    left, _, right = np.linalg.svd(axes)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = left @ right, matrix[:3, 3]
    return pose


def chosen(names: Sequence[str], name: str | None, path: Path) -> int:
    """Which of a file's cameras is meant.

    Raises:
        SceneFileError: there is none, there are several and no name is given, or none of that name.
    """
    if not names:
        raise SceneFileError(
            f"{path}: has no camera; export the scene with one, or give camera.position and look_at"
        )
    if name is None:
        if len(names) > 1:
            raise SceneFileError(f"{path}: has {len(names)} cameras, {listed(names)}; say which by its name")
        return 0
    if name not in names:
        known = f"it has {listed(names)}"
        raise SceneFileError(f"{path}: has no camera {name!r}; {did_you_mean(name, names, known)}")
    return list(names).index(name)
