"""The accumulation buffer: many pinhole views, averaged."""

import numpy as np

from focusjax._counts import require_counts
from focusjax._parallel import in_parallel
from focusjax.baselines._through_lens import STEPS, RayScene, blocks, pixel_corners, radiance
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.scene import Scene


def accumulate(scene: Scene | RayScene, camera: Camera, lens: AbstractLens, *, views: int = 64) -> np.ndarray:
    """Linear picture [h, w, 3] as the mean of `views` pinhole views from points spread over the lens.

    The accumulation buffer (Haeberli and Akeley 1990, section 4.3): every view is taken from one point of
    the opening, sheared so that what is in focus stays put, and shifted within the pixel against aliasing.
    All pixels share the points, so that too few views show as ghosts, not as noise.

    Args:
        scene: what to see.
        camera: frame and pose.
        lens: where rays go.
        views: pinhole pictures to average.

    Raises:
        ValueError: fewer than one view, or Embree is not installed.
    """
    require_counts(views=views)
    ready = scene if isinstance(scene, RayScene) else RayScene(scene)
    pixel = pixel_corners(camera)
    squares = (0.5 + np.arange(views)[:, None] * STEPS) % 1.0

    def mean_of(block: slice) -> np.ndarray:
        total = np.zeros((len(pixel[block]), 3))
        for square in squares:
            pupil = np.broadcast_to(square[2:], (len(total), 2))
            total += radiance(ready, camera, lens, pixel[block] + square[:2], pupil)
        return total / views

    means = in_parallel(mean_of, blocks(len(pixel)))
    return np.concatenate(means).reshape(camera.height, camera.width, 3)
