"""Flat things that several scripts make their scenes of."""

import numpy as np

from focusjax.geometry import Camera
from focusjax.scene import SceneObject, make_object

QUAD = np.array([(0, 1, 2), (0, 2, 3)])
"""The two triangles of four corners in order."""


def quad_faces(count: int) -> np.ndarray:
    """Triangles [2 count, 3] of quads whose corners follow each other four by four."""
    return (4 * np.arange(count)[:, None, None] + QUAD).reshape(-1, 3)


def squares(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A grid of unit squares that share no corners, row by row.

    Returns:
        columns [n, 4] and rows [n, 4] of all corners, of which the first is the square's own; faces [2 n, 3].
    """
    row, column = (index.reshape(-1, 1) for index in np.mgrid[:rows, :columns])
    return column + np.array([0, 1, 1, 0]), row + np.array([0, 0, 1, 1]), quad_faces(rows * columns)


def shining(name: str, corners: np.ndarray, radiance: object) -> SceneObject:
    """A quad that emits light and reflects none."""
    return make_object(name, corners, QUAD, colour=(0, 0, 0), emission=radiance)


def in_world(xy: np.ndarray, disparity: np.ndarray | float, camera: Camera) -> np.ndarray:
    """World points [n, 3] at pixels `xy` [n, 2] and `disparity` (1/m) of a camera at the origin."""
    centre = np.array([camera.width / 2, camera.height / 2])
    x, y = ((np.asarray(xy, dtype=float) - centre) / float(camera.focal_px)).T
    return np.stack([x, -y, -np.ones_like(x)], axis=1) / np.broadcast_to(disparity, x.shape)[:, None]
