"""Layers as a config's render table has them."""

from typing import Any, Protocol, runtime_checkable

from focusjax.geometry import Camera
from focusjax.layers import Extent, Layers, decompose, peel
from focusjax.lens import AbstractLens
from focusjax.scene import Scene


@runtime_checkable
class LayerSettings(Protocol):
    """How layers are made; names and meanings as in `peel` and `decompose`."""

    @property
    def supersampling(self) -> int: ...
    @property
    def max_layers(self) -> int: ...
    @property
    def slabs(self) -> int | None: ...
    @property
    def slab_blur_px(self) -> float | None: ...
    @property
    def view_dependent(self) -> bool: ...
    @property
    def pixel_filter(self) -> str: ...


def room_for_more(table: LayerSettings) -> str:
    """What to change so that more surfaces find a place in the layers."""
    if table.slab_blur_px is not None:
        return "lower render.slab_blur_px"
    return "raise render.max_layers" if table.slabs is None else "raise render.slabs"


def make_layers(
    table: LayerSettings,
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    like: Layers | Extent | None = None,
    *,
    spare: bool = False,
) -> Layers:
    """Peeled, or in slabs when `table` says how many or how thick; `like` and `spare` are as for `peel`."""
    options: dict[str, Any] = {
        "supersampling": table.supersampling,
        "view_dependent": table.view_dependent,
        "pixel_filter": table.pixel_filter,
        "like": like,
        "spare": spare,
    }
    if table.slabs is None and table.slab_blur_px is None:
        return peel(scene, camera, lens, max_layers=table.max_layers, **options)
    return decompose(scene, camera, lens, count=table.slabs, blur_step=table.slab_blur_px, **options)
