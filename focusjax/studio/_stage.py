"""What stands in front of the camera, built once: the scene and what every pixel sees of it."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from focusjax.config import Config, build_camera, build_scene
from focusjax.geometry import Camera
from focusjax.layers import first_surfaces
from focusjax.scene import Scene


@dataclasses.dataclass(frozen=True, eq=False)
class Stage:
    """A scene from one camera.

    Attributes:
        scene: what there is to see.
        camera: as the config frames it, before any solve.
        disparity: first surface at every pixel centre in 1/m [h, w]; 0 on the background.
        face: number of the scene's face that is seen there [h, w]; -1 for none.
    """

    scene: Scene
    camera: Camera
    disparity: Float[np.ndarray, "h w"]
    face: Int[np.ndarray, "h w"]

    def object_at(self, column: int, row: int) -> str:
        """Name of the object that a pixel sees; empty on the background."""
        face = int(self.face[row, column])
        return next((name for name, faces in self.scene.objects.items() if face in faces), "")

    def seen_from(self, camera: Camera) -> "Stage":
        """The same scene from another camera."""
        return Stage(self.scene, camera, *first_surfaces(self.scene, camera))


class StageMaker:
    """Builds stages and keeps the last one, and its scene, for as long as they serve."""

    def __init__(self) -> None:
        self._config: Config | None = None
        self._stage: Stage | None = None

    def stage_for(self, config: Config) -> Stage:
        """The stage of `config`; wishes, lens and what else it says leave it as it was.

        Raises:
            ConfigError: a mesh or a camera that cannot be used.
        """
        last, stage = self._config, self._stage
        same_scene = last is not None and last.scene == config.scene and last.source == config.source
        if stage is None or last is None or not (same_scene and last.camera == config.camera):
            scene = stage.scene if stage is not None and same_scene else build_scene(config)
            camera = build_camera(config)
            stage = Stage(scene, camera, *first_surfaces(scene, camera))
        self._config, self._stage = config, stage
        return stage
