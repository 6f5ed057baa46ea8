"""Layers by depth peeling: frame, rasterise, peel, assemble."""

import numpy as np

from focusjax._arguments import require_switches
from focusjax._counts import require_counts
from focusjax._freed import return_freed
from focusjax.geometry import Camera
from focusjax.layers._assemble import assemble
from focusjax.layers._frame import frame
from focusjax.layers._grid import Extent
from focusjax.layers._layers import Layers, extent_like
from focusjax.layers._memory import check_layers
from focusjax.layers._peel import peel_fragments
from focusjax.layers._picture import rasterised, rasterised_for
from focusjax.lens import AbstractLens
from focusjax.scene import Scene


def peel(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    *,
    supersampling: int = 1,
    max_layers: int = 8,
    near: float | None = None,
    umbra: bool = True,
    view_dependent: bool = False,
    pixel_filter: str = "box",
    like: Layers | Extent | None = None,
) -> Layers:
    """Every surface that a ray of `lens` can reach, as layers seen from the lens centre.

    Args:
        scene: what is in front of the camera.
        camera: frame and pose.
        lens: the layers serve it and every lens whose rays stay within its own.
        supersampling: layer samples per output pixel and axis. Radiances are means over the area of a
            sample, and silhouettes lie where they are inside it, so that one does for most pictures. Two are
            worth their time, three to five times as long, where much in focus is smaller than a pixel: wires,
            twigs, several leaves in one pixel.
        max_layers: stop here; `complete` on the result says whether more was left.
        near: depth in metres from which surfaces count; a tenth of the focal length if not given.
        umbra: leave out what no ray of the lens can reach (Lee10 section 3.1). Without it each layer is
            the next surface, however hidden: more layers for the same picture. `umbra_saving` counts both.
        view_dependent: keep normals and materials, so that every lens ray sees highlights and mirrored
            surroundings from its own point of the lens (Lee09 section 5), for 5 bytes more a sample.
            Otherwise they are painted on the surfaces as the lens centre sees them, which is quicker. Nothing
            changes for scenes without either.
        pixel_filter: "box", "tent" or "gaussian": how a pixel weighs the light around its centre, which
            `render` follows. Rays of the wider two start up to 1 and 1.5 pixels from it, so that those at the
            border need layers beyond the frame; layers for one filter serve narrower ones, too.
        like: layers of another moment, or an `Extent`, of as many pixels: the margin is at least theirs, and
            so are the number of layers up to `max_layers` and the room for samples, so that programs compiled
            for them serve again, if the scene has as many vertices as then. (`make_object` splits vertices
            at creases, which may come and go as a mesh deforms: `focusjax.shot.MovingScene` keeps them.)

    Raises:
        ValueError: a count that is not whole or below 1; no such filter; a surface so close to the lens that
            the margin its blur needs does not fit in memory; more layers than this machine's memory holds,
            with the number that would fit; or layers to be like that are of another frame.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> scene = fj.make_scene([wall], unlit=True)
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(scene, camera, lens)
        >>> layers.count, layers.complete
        (1, True)
        >>> moved = fj.make_scene([fj.make_object("wall", wall.vertices - [0, 0, 1], wall.faces)], unlit=True)
        >>> later = fj.peel(moved, camera, lens, like=layers)
        >>> later.extent == layers.extent, round(1 / float(later.disparity.max()), 3)
        (True, 3.0)
    """
    require_counts(supersampling=supersampling, max_layers=max_layers)
    require_switches(umbra=umbra, view_dependent=view_dependent)
    like = extent_like(like)
    picture = rasterised_for(
        scene,
        camera,
        lens,
        supersampling=supersampling,
        near=near,
        pixel_filter=pixel_filter,
        like=like,
    )
    parallax = float(lens.parallax(camera)) * supersampling
    chosen, left_out = peel_fragments(
        picture.fragments, picture.grid, parallax, max_layers, umbra=umbra, opacity=picture.opacity
    )
    counts = [len(some) for some in chosen]
    check_layers(picture.grid, counts, "max_layers")
    handed_over = [picture.held(chosen)]
    del chosen, picture
    return_freed(sum(counts))
    # Nothing here holds on to the fragments, so that they are freed once their layers are made of them.
    layers = assemble(
        scene,
        camera,
        lens,
        handed_over.pop(),
        counts,
        max_layers=max_layers,
        left_out=left_out,
        like=like,
        view_dependent=view_dependent,
        pixel_filter=pixel_filter,
    )
    return_freed(sum(counts))
    return layers


def disparity_map(scene: Scene, camera: Camera) -> np.ndarray:
    """Disparity in 1/m [h, w] of the first surface at every pixel centre; 0 where there is none.

    A surface counts where at least half of it is there: a window pane does not hide the garden.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> disparity = fj.disparity_map(fj.make_scene([wall]), camera)
        >>> disparity.shape, round(float(disparity[3, 4]), 6)
        ((6, 8), 0.5)
    """
    return first_surfaces(scene, camera)[0]


def first_surfaces(scene: Scene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """As `disparity_map`, and the number [h, w] of the scene's face that is seen there; -1 for none."""
    picture = rasterised(scene, camera, *frame(scene, camera, None, 1, None))
    fragments, grid = picture.fragments, picture.grid
    if picture.opacity is not None:
        fragments = fragments.take(np.flatnonzero(picture.opacity >= 0.5))
    chosen, _ = peel_fragments(fragments, grid, 0.0, 1)
    disparity, face = np.zeros(grid.size), np.full(grid.size, -1)
    for layer in chosen:
        disparity[fragments.sample[layer]] = fragments.disparity[layer]
        face[fragments.sample[layer]] = picture.triangles.source[fragments.triangle[layer]]
    shape = grid.rows, grid.columns
    return disparity.reshape(shape), face.reshape(shape)
