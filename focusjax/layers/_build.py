"""Layers by depth peeling: frame, rasterise, peel, assemble."""

import numpy as np

from focusjax.geometry import Camera
from focusjax.layers._assemble import assemble, rasterised
from focusjax.layers._frame import frame
from focusjax.layers._layers import Layers
from focusjax.layers._memory import check_memory
from focusjax.layers._peel import peel_fragments
from focusjax.lens import AbstractLens
from focusjax.scene import Scene


def peel(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    *,
    supersampling: int = 2,
    max_layers: int = 8,
    near: float | None = None,
) -> Layers:
    """Every surface that a ray of `lens` can reach, as layers seen from the lens centre.

    Args:
        scene: what is in front of the camera.
        camera: frame and pose.
        lens: the layers serve it and every lens whose rays stay within its own.
        supersampling: layer samples per output pixel and axis. Two keep edges in focus clean;
            one is quicker where all is blurred.
        max_layers: stop here; `complete` on the result says whether more was left.
        near: depth in metres from which surfaces count; a tenth of the focal length if not given.

    Raises:
        ValueError: a count below 1, or a surface so close to the lens that the margin its blur needs
            does not fit in memory; or more layers than this machine's memory holds, with the number that
            would fit.
    """
    for name, value in (("supersampling", supersampling), ("max_layers", max_layers)):
        if value < 1:
            raise ValueError(f"{name} is {value}; expected at least 1")
    parallax = float(lens.parallax(camera)) * supersampling
    triangles, grid = frame(scene, camera, lens, supersampling, near)
    check_memory(grid, max_layers)
    picture = rasterised(scene, camera, triangles, grid)
    chosen, complete = peel_fragments(
        picture.fragments, picture.grid, parallax, max_layers, opacity=picture.opacity
    )
    return assemble(scene, camera, lens, picture, chosen, max_layers=max_layers, complete=complete)


def disparity_map(scene: Scene, camera: Camera) -> np.ndarray:
    """Disparity in 1/m [h, w] of the first surface at every pixel centre; 0 where there is none.

    A surface counts where at least half of it is there: a window pane does not hide the garden.
    """
    picture = rasterised(scene, camera, *frame(scene, camera, None, 1, None))
    fragments, grid = picture.fragments, picture.grid
    if picture.opacity is not None:
        fragments = fragments.take(np.flatnonzero(picture.opacity >= 0.5))
    chosen, _ = peel_fragments(fragments, grid, 0.0, 1)
    out = np.zeros((grid.rows, grid.columns))
    for owner in chosen:
        out[owner >= 0] = fragments.disparity[owner[owner >= 0]]
    return out
