"""The sample grid that layers live on: the picture, refined and framed by a margin."""

import dataclasses

import numpy as np

from focusjax.geometry import Camera


@dataclasses.dataclass(frozen=True)
class Grid:
    """Layer samples: `supersampling` per output pixel and axis, `margin` more on every side.

    A position q in output pixels lies at `supersampling * q + margin` on the grid, whose sample
    (i, j) has its centre at (i + 0.5, j + 0.5).
    """

    width: int
    height: int
    supersampling: int
    margin: int

    @property
    def columns(self) -> int:
        """Samples per row."""
        return self.width * self.supersampling + 2 * self.margin

    @property
    def rows(self) -> int:
        """Rows of samples."""
        return self.height * self.supersampling + 2 * self.margin

    @property
    def size(self) -> int:
        """Samples in one layer."""
        return self.rows * self.columns


def homogeneous_image(vertices: np.ndarray, camera: Camera, grid: Grid) -> np.ndarray:
    """Homogeneous grid positions (x z, y z, z) [v, 3] of world `vertices` [v, 3], z being depth.

    They are linear in the vertices, in front of the camera and behind. Host double precision: a
    vertex shared by two triangles must land on one place whichever of them asks.
    """
    pose = np.asarray(camera.world_from_camera, dtype=np.float64)
    # A column at a time: threads of a matrix product of three columns take longer to start than it takes.
    away = [vertices[:, k] - pose[k, 3] for k in range(3)]
    x, y, z = (away[0] * axis[0] + away[1] * axis[1] + away[2] * axis[2] for axis in pose[:3, :3].T)
    focal = float(camera.focal_px) * grid.supersampling
    centre = np.asarray(camera.principal_point, dtype=np.float64) * grid.supersampling + grid.margin
    return np.stack([focal * x - centre[0] * z, -focal * y - centre[1] * z, -z]).T
