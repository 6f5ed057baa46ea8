"""What a scene covers on the grid that its layers need: the common start of peeling and of cutting slabs."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from focusjax._freed import keep_blocks_apart
from focusjax.geometry import Camera
from focusjax.layers._boxes import boxes_on
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._frame import frame
from focusjax.layers._grid import Extent, Grid
from focusjax.layers._memory import check_fragments, check_frame
from focusjax.layers._opacity import with_opacity
from focusjax.layers._raster import Fragments, dice, rasterise
from focusjax.lens import AbstractLens
from focusjax.scene import Scene


@dataclasses.dataclass(frozen=True)
class Rasterised:
    """Triangles on a grid, all that they cover there, and how much of it is there (None: all of it)."""

    triangles: ScreenTriangles
    grid: Grid
    fragments: Fragments
    opacity: np.ndarray | None

    def held(self, chosen: Sequence[Int[np.ndarray, " _"]]) -> "Rasterised":
        """The same with the fragments `chosen` for each layer alone, one layer after the other."""
        index = np.concatenate([np.zeros(0, dtype=np.intp), *chosen])
        opacity = None if self.opacity is None else self.opacity[index]
        return dataclasses.replace(self, fragments=self.fragments.take(index), opacity=opacity)


def rasterised(scene: Scene, camera: Camera, triangles: ScreenTriangles, grid: Grid) -> Rasterised:
    """Everything that `triangles` of `scene` cover on `grid`.

    Raises:
        ValueError: more than this machine's memory holds.
    """
    boxes = boxes_on(grid, triangles)
    check_fragments(triangles, boxes, grid)
    covered = rasterise(triangles, dice(triangles, boxes), grid)
    return Rasterised(triangles, grid, *with_opacity(scene, camera, triangles, grid, covered))


def rasterised_for(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    *,
    supersampling: int,
    near: float | None,
    pixel_filter: str = "box",
    like: Extent | None = None,
) -> Rasterised:
    """Everything that rays of `lens` from film points of `pixel_filter` can reach.

    Raises:
        ValueError: a grid of which no layer fits in memory, or layers to be like that are of another frame.
    """
    margin = _margin_like(like, camera, supersampling)
    triangles, grid = frame(
        scene, camera, lens, supersampling, near, least_margin=margin, pixel_filter=pixel_filter
    )
    check_frame(grid)
    keep_blocks_apart(4 * grid.size)
    return rasterised(scene, camera, triangles, grid)


def _margin_like(like: Extent | None, camera: Camera, supersampling: int) -> int:
    """The margin in samples of layers to be like, 0 if there are none.

    Raises:
        ValueError: they are of another frame.
    """
    if like is None:
        return 0
    theirs = like.grid
    if not like.serves(camera, supersampling):
        raise ValueError(
            f"the layers to be like are of {theirs.width} x {theirs.height} pixels at a supersampling of"
            f" {theirs.supersampling}; expected {camera.width} x {camera.height} at {supersampling}, so leave"
            " `like` out"
        )
    return theirs.margin
