"""Layers by depth peeling: frame, rasterise, peel, assemble; and what the extended umbra saves of them."""

import dataclasses

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
from focusjax.layers._raster import Fragments
from focusjax.layers._umbra import SEPARATION
from focusjax.lens import AbstractLens
from focusjax.scene import Scene

_MOST_LAYERS = 4096
"""That the umbra's saving is counted over."""


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
    spare: bool = False,
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
        spare: leave room for later layers like these. More layers than `like` has, if more are needed, are
            then two more than that and at least four, up to `max_layers`; more room is twice that and at
            least that of 32,768 samples. Nothing is spare where memory is short. No picture changes.

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
    require_switches(umbra=umbra, view_dependent=view_dependent, spare=spare)
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
        spare=spare,
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


@dataclasses.dataclass(frozen=True)
class UmbraSaving:
    """Samples in each layer, first layer first, of the same scene peeled in both ways to the end.

    Attributes:
        umbra: samples kept in each layer that extended-umbra peeling finds.
        plain: samples in each layer that plain peeling finds.
    """

    umbra: tuple[int, ...]
    plain: tuple[int, ...]

    @property
    def samples_saved(self) -> float:
        """Share of the samples of plain peeling that the umbra leaves out."""
        return 1.0 - sum(self.umbra) / sum(self.plain) if self.plain else 0.0

    @property
    def layers_saved(self) -> int:
        """Layers of plain peeling that the umbra leaves out."""
        return len(self.plain) - len(self.umbra)


def umbra_saving(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    *,
    supersampling: int = 1,
    near: float | None = None,
) -> UmbraSaving:
    """Layers and samples that `peel` keeps with the umbra and without, as deep as the scene goes.

    Nothing is shaded or joined, so that it takes less time and memory than peeling twice. Samples added along
    silhouettes (see `Layers.disparity`) do not count.

    Args:
        scene: what is in front of the camera.
        camera: frame and pose.
        lens: whose rays decide what is hidden.
        supersampling: layer samples per output pixel and axis.
        near: depth in metres from which surfaces count; a tenth of the focal length if not given.

    Raises:
        ValueError: a supersampling that is not whole or below 1, or a grid that does not fit in memory.

    Example:
        >>> from focusjax import look_at, make_scene, thin_lens
        >>> from focusjax.scene import make_object
        >>> walls = [
        ...     make_object(name, [(-9, -9, z), (9, -9, z), (0, 9, z)], [(0, 1, 2)])
        ...     for name, z in (("near", -2.0), ("far", -2.5))
        ... ]
        >>> camera = look_at((0, 0, 0), (0, 0, -1), width=8, height=8, field_of_view=0.5)
        >>> lens = thin_lens(focus_distance=2.0, aperture_radius=0.01)
        >>> saving = umbra_saving(make_scene(walls), camera, lens)
        >>> len(saving.umbra), len(saving.plain)
        (1, 2)
    """
    require_counts(supersampling=supersampling)
    picture = rasterised_for(scene, camera, lens, supersampling=supersampling, near=near)
    parallax = float(lens.parallax(camera)) * supersampling
    kept, _ = peel_fragments(picture.fragments, picture.grid, parallax, _MOST_LAYERS, opacity=picture.opacity)
    counts = tuple(len(layer) for layer in kept)
    return UmbraSaving(counts, _surfaces_by_depth(picture.fragments))


def _surfaces_by_depth(fragments: Fragments) -> tuple[int, ...]:
    """How many samples have a first surface, a second, and so on: plain peeling's layers by one sort."""
    depth_bits = (1.0 / fragments.disparity.astype(np.float32)).view(np.uint32)
    key = np.sort(fragments.sample.astype(np.uint64) << np.uint64(32) | depth_bits)
    sample, depth = key >> np.uint64(32), key.astype(np.uint32).view(np.float32)
    first = np.ones(len(key), dtype=bool)
    first[1:] = sample[1:] != sample[:-1]
    # Surfaces in the same place are one.
    distinct = np.flatnonzero(first | (np.diff(depth, prepend=0.0) > SEPARATION * depth))
    start = np.flatnonzero(first[distinct])
    layer = np.arange(len(distinct)) - np.repeat(start, np.diff(start, append=len(distinct)))
    return tuple(int(count) for count in np.bincount(layer))
