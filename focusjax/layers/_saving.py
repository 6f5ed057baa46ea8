"""What the extended umbra saves: layers and samples kept, against plain depth peeling."""

import dataclasses

import numpy as np

from focusjax._counts import require_counts
from focusjax.geometry import Camera
from focusjax.layers._peel import peel_fragments
from focusjax.layers._picture import rasterised_for
from focusjax.layers._raster import Fragments
from focusjax.layers._umbra import SEPARATION
from focusjax.lens import AbstractLens
from focusjax.scene import Scene

_MOST_LAYERS = 4096


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
