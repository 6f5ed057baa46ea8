"""The layered picture that lens rays are traced through."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.layers._grid import Extent, Grid
from focusjax.layers._places import Places
from focusjax.layers._pyramid import RangePyramid
from focusjax.layers._shading import GlossSamples
from focusjax.lens import AbstractLens


class Samples(eqx.Module):
    """What the layers hold, without the room where nothing is: n samples in the order of their flat index.

    Zeros follow the last one, so that programs compiled for one number of samples serve for others.

    Attributes:
        index: flat index [n] in `Layers.cells`.
        disparity: 1/m [n].
        radiance: linear radiance [n, 3], without what `gloss` adds.
        triangle: the scene's face [n] at the sample's centre; -1 where none is there (and after the last).
        links: packed joins [n] to the eight neighbours; see `_joins`.
        opacity: share [n] of each sample's surface that is there, 0 to 1 in steps of 1/255; None where all
            are opaque.
        gloss: what highlights and mirrored surroundings depend on, for each ray to work them out; None where
            they are in `radiance` already, as seen from the lens centre.
    """

    index: Int[Array, " n"]
    disparity: Float[Array, " n"]
    radiance: Float[Array, "n 3"]
    triangle: Int[Array, " n"]
    links: UInt[Array, " n"]
    opacity: Float[Array, " n"] | None
    gloss: GlossSamples | None


@dataclasses.dataclass(frozen=True, eq=False)
class LeftOut:
    """A number of samples that equals all others, so that it compiles nothing anew."""

    count: int

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LeftOut)

    def __hash__(self) -> int:
        return 0

    def __repr__(self) -> str:
        return str(self.count)


class Layers(eqx.Module):
    """Surfaces seen from the lens centre, nearest first: peeled (Lee10 section 3.1) or in slabs (Lee09).

    Layers share the grid [h, w] of `grid`: `supersampling` samples per output pixel and a margin around the
    frame for rays that leave it. A sample stands for the square of surface around its centre; where
    surfaces continue into a neighbouring sample the two are joined. Fringe samples, where a surface reaches
    into the square but misses its centre, lie in the first layer that is free there.

    What a ray reads at every step has a place in `cells` for every sample of the grid; the rest is kept for
    those that hold something, in `samples`. `disparity` and its like spread them out again.

    Attributes:
        cells: packed disparity interval and outline [l, h, w] of each sample, 0 where nothing is; see
            `_cells`.
        places: from the flat index of a sample to its position in `samples`.
        samples: the surface at each sample that is there.
        background: radiance at infinity [h, w, 3], or [3] where it is the same all over.
        ranges: least and largest disparity over any square, all layers together.
        disparity_scale: dioptres per step of `cells`.
        lens: the lens that the layers were made for.
        camera: the camera they are seen from.
        grid: the sample grid (static).
        complete: whether every surface is here but those known to be hidden (static).
        left_out: samples of surface that found no layer, as far as known to be seen (static, but of no
            account to compiled programs: layers that differ in it alone are traced by one program).
        pixel_filter: the widest filter whose rays they hold (static); see `peel`.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens)
        >>> layers.count, layers.complete, round(float(layers.disparity.max()), 3)
        (1, True, 0.5)
    """

    cells: UInt[Array, "l h w"]
    places: Places
    samples: Samples
    background: Float[Array, "h w 3"] | Float[Array, "3"]
    ranges: RangePyramid
    disparity_scale: Float[Array, ""]
    lens: AbstractLens
    camera: Camera
    grid: Grid = eqx.field(static=True)
    complete: bool = eqx.field(static=True)
    pixel_filter: str = eqx.field(static=True)
    left_out: LeftOut = eqx.field(static=True)

    def __repr__(self) -> str:
        size = f"{self.grid.width} x {self.grid.height} pixels"
        return f"Layers({self.count} of {size}, peeled for a {type(self.lens).__name__})"

    @property
    def count(self) -> int:
        """Number of layers, with the empty ones that are added so that few different numbers occur."""
        return self.cells.shape[0]

    @property
    def filled(self) -> int:
        """Number of layers that hold anything; one at least."""
        return max(1, int((np.asarray(self.cells) > 0).any(axis=(1, 2)).sum()))

    @property
    def extent(self) -> Extent:
        """How large they are."""
        return Extent(self.grid, self.count, self.samples.disparity.shape[0])

    @property
    def samples_kept(self) -> int:
        """Samples that hold a surface at their centre, over all layers."""
        return int((np.asarray(self.samples.triangle) >= 0).sum())

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays together, N-buffers included."""
        return sum(array.nbytes for array in jax.tree.leaves(eqx.filter(self, eqx.is_array)))

    @property
    def disparity(self) -> Float[Array, "l h w"]:
        """1/m; 0 where the layer holds nothing.

        Decreasing from layer to layer where surfaces are at the samples' centres. Fringe samples take the
        first layer that is free, so that a nearer one may come after a farther one.
        """
        return spread(self, self.samples.disparity, 0.0)

    @property
    def radiance(self) -> Float[Array, "l h w 3"]:
        """Linear radiance, without gloss that is kept apart; 0 where the layer holds nothing."""
        return spread(self, self.samples.radiance, 0.0)

    @property
    def triangle(self) -> Int[Array, "l h w"]:
        """The scene's face at the sample's centre; -1 where there is none."""
        return spread(self, self.samples.triangle, -1)

    @property
    def opacity(self) -> Float[Array, "l h w"] | None:
        """Share of each sample's surface that is there; None where all are opaque."""
        return None if self.samples.opacity is None else spread(self, self.samples.opacity, 0.0)


def extent_like(like: Layers | Extent | None) -> Extent | None:
    """The extent of what a user wants layers to be like.

    Raises:
        ValueError: it has none.
    """
    if like is None or isinstance(like, Extent):
        return like
    if not isinstance(like, Layers):
        raise ValueError(
            f"like is {like!r}; expected layers that `peel` or `decompose` made, or their `extent`"
        )
    return like.extent


@jit
def _spread(cells: UInt[Array, "l h w"], values: Array, fill: Array) -> Array:
    there = cells.reshape(-1) > 0
    number = jnp.cumsum(there, dtype=jnp.int32) - 1
    out = jnp.where(there.reshape(-1, *[1] * (values.ndim - 1)), values[number], fill)
    return out.reshape(*cells.shape, *values.shape[1:])


def spread(layers: Layers, values: Array, fill: float) -> Array:
    """Values [n, ...] of the samples of `layers` at their places [l, h, w, ...], `fill` where none is."""
    return _spread(layers.cells, values, jnp.asarray(fill, dtype=values.dtype))
