"""The sample grid of layers, the picture refined and framed by a margin; and how large layers are."""

import dataclasses

import numpy as np

from focusjax.geometry import Camera

_SPARE_LAYERS, _SPARE_ROOM = 2, 2
"""Layers beyond what is needed, and times the room for samples, that are spare."""
_SPARED_LAYERS, _SPARED_ROOM = 4, 1 << 15
"""At least so many where some are spare: a thing that comes nearer is soon many times as large as it was."""


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


@dataclasses.dataclass(frozen=True)
class Extent:
    """Sizes of layers, for others to be made `like` them.

    Attributes:
        grid: the sample grid, with the margin that is the least.
        count: number of layers.
        room: samples that there is room for.
    """

    grid: Grid
    count: int
    room: int

    def serves(self, camera: Camera, supersampling: int) -> bool:
        """Whether layers of this frame can be like these."""
        grid = self.grid
        frame = camera.width, camera.height, supersampling
        return (grid.width, grid.height, grid.supersampling) == frame

    def for_others(self) -> "Extent":
        """The same number of layers and room, without a margin, for layers of other lenses and moments.

        Empty layers and room change nothing in a picture. A margin moves the grid, and with it the rounding
        of positions: each picture is to have its own, whatever came before it.
        """
        return dataclasses.replace(self, grid=dataclasses.replace(self.grid, margin=0))


def sizes_like(count: int, room: int, like: Extent | None, *, spare: bool) -> tuple[int, int]:
    """Numbers of layers and of samples to make room for, where so many are needed.

    Those of `like` where they are enough; otherwise as many as needed, and more where some are to be `spare`.
    """
    most_layers, most_room = (0, 0) if like is None else (like.count, like.room)
    if count > most_layers:
        most_layers = max(count + _SPARE_LAYERS, _SPARED_LAYERS) if spare else count
    if room > most_room:
        most_room = max(_SPARE_ROOM * room, _SPARED_ROOM) if spare else room
    return most_layers, most_room
