"""The layered picture that lens rays are traced through."""

import equinox as eqx
import jax
from jaxtyping import Array, Float, Int, UInt

from focusjax.geometry import Camera
from focusjax.layers._gloss import GlossSamples
from focusjax.layers._grid import Grid
from focusjax.layers._pyramid import RangePyramid
from focusjax.lens import AbstractLens


class Layers(eqx.Module):
    """Surfaces seen from the lens centre, nearest first: peeled (Lee10 section 3.1) or in slabs (Lee09).

    All arrays share the grid [h, w] of `grid`: `supersampling` samples per output pixel and a
    margin around the frame for rays that leave it. A sample stands for the square of surface
    around its centre; where surfaces continue into a neighbouring sample the two are joined.

    Attributes:
        disparity: 1/m [l, h, w]; 0 where the layer holds nothing. Fringe samples, where a surface reaches
            into the square but misses its centre, lie in the first layer that is free there.
        radiance: linear radiance [l, h, w, 3], without what `gloss` adds.
        triangle: the scene's face [l, h, w] at the sample's centre; -1 where there is none.
        cells: packed disparity interval and outline [l, h, w] of each sample; see `_cells`.
        links: packed joins [l, h, w] to the eight neighbours; see `_joins`.
        opacity: share [l, h, w] of each sample's surface that is there, 0 to 1 in steps of 1/255; None where
            all are opaque.
        background: radiance [h, w, 3] at infinity.
        ranges: least and largest disparity over any square, all layers together.
        disparity_scale: dioptres per step of `cells`.
        lens: the lens that the layers were made for.
        camera: the camera they are seen from.
        grid: the sample grid (static).
        complete: whether every surface is here but those known to be hidden (static).
        gloss: what highlights and mirrored surroundings depend on, for each ray to work them out; None where
            they are in `radiance` already, as seen from the lens centre.
    """

    disparity: Float[Array, "l h w"]
    radiance: Float[Array, "l h w 3"]
    triangle: Int[Array, "l h w"]
    cells: UInt[Array, "l h w"]
    links: UInt[Array, "l h w"]
    opacity: Float[Array, "l h w"] | None
    background: Float[Array, "h w 3"]
    ranges: RangePyramid
    disparity_scale: Float[Array, ""]
    lens: AbstractLens
    camera: Camera
    grid: Grid = eqx.field(static=True)
    complete: bool = eqx.field(static=True)
    gloss: GlossSamples | None = None

    @property
    def count(self) -> int:
        """Number of layers."""
        return self.disparity.shape[0]

    @property
    def samples_kept(self) -> int:
        """Samples that hold a surface, over all layers."""
        return int((self.triangle >= 0).sum())

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays together, N-buffers included."""
        return sum(array.nbytes for array in jax.tree.leaves(eqx.filter(self, eqx.is_array)))
