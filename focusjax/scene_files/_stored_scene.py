"""A scene as a file has it, in focusjax's units and axes."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from focusjax.scene import AbstractLight, SceneObject


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
