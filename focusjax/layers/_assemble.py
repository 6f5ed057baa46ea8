"""From the fragments chosen for each layer to `Layers`: attributes, joins, silhouettes, shading."""

import concurrent.futures
import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from focusjax._freed import return_freed
from focusjax._parallel import in_this_precision
from focusjax.geometry import Camera
from focusjax.layers._attributes import SurfaceSamples, surface_samples
from focusjax.layers._blocks import coarse_number
from focusjax.layers._cells import WHOLE, in_steps, pack_cells
from focusjax.layers._grid import Extent, Grid, sizes_like
from focusjax.layers._joins import Joins, Planes, join
from focusjax.layers._layers import Layers, LeftOut, Samples
from focusjax.layers._means import Seen, mean_radiances
from focusjax.layers._memory import layers_fit
from focusjax.layers._picture import Rasterised
from focusjax.layers._places import make_places, on_device, scattered
from focusjax.layers._pyramid import RangePyramid, build_ranges
from focusjax.layers._shading import GlossSamples, ShadedSamples, background
from focusjax.layers._silhouettes import Silhouettes, find_silhouettes
from focusjax.lens import AbstractLens
from focusjax.scene import Gloss, Scene

_LEAST_ROOM = 1 << 10
_MANY = 1 << 22
"""Samples, beyond which memory counts more than time."""
_LAYERS_STEP = 4
"""Numbers of layers above this are multiples of it; smaller ones are powers of two."""


def assemble(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    held: Rasterised,
    counts: Sequence[int],
    *,
    max_layers: int,
    left_out: int,
    like: Extent | None = None,
    spare: bool = False,
    view_dependent: bool = False,
    pixel_filter: str = "box",
) -> Layers:
    """Layers of the fragments in `held`: `counts` for each layer, in the order of their samples.

    `left_out` fragments found no layer. `like` and `spare` say how large others are or may be; see `peel`.
    """
    gloss = scene.gloss() if view_dependent else None
    triangles, grid, fragments = held.triangles, held.grid, held.fragments
    parallax = float(lens.parallax(camera)) * grid.supersampling
    surface = surface_samples(triangles, fragments.sample, fragments.triangle, grid)
    real = np.zeros(0, dtype=jnp.zeros(()).dtype).dtype
    disparity = fragments.disparity.astype(real, copy=False)
    opacity = None if held.opacity is None else held.opacity.astype(real, copy=False)
    return_freed(sum(counts))

    outline = _outlined(held, counts, surface, parallax, max_layers, real)
    seen = Seen(
        outline.index % np.int32(grid.size),
        np.concatenate([disparity, outline.disparity]),
        outline.low,
        outline.high,
        np.concatenate([np.arange(len(disparity), dtype=np.int32), outline.source]),
        outline.line != WHOLE,
        outline.index,
    )
    # Shading needs nothing of ranges, cells and places: while one compiles or waits, the other works.
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        tolerance = 0.5 / max(parallax, 1e-12)
        apart = gloss is not None
        shade = in_this_precision(mean_radiances)
        shading = pool.submit(shade, scene, camera, held, surface, seen, tolerance, gloss_apart=apart)
        cell, face = seen.cell, surface.face
        del surface, seen, held, fragments, triangles
        if len(cell) > _MANY:
            # Both at once would hold too much.
            concurrent.futures.wait([shading])
        count, room = _sizes(outline, grid, max_layers, like, spare=spare)
        least, most, scale = in_steps(outline.low, outline.high)
        words = pack_cells(least, most, outline.line)
        places, number = make_places(count * grid.size, outline.index)
        ranges = _ranges(cell, least, most, scale, grid, real)
        cells = scattered((count, grid.rows, grid.columns), outline.index, words)
        far = background(scene, camera, grid)
        look = shading.result()
        index, source, links, beyond = outline.index, outline.source, outline.links, outline.disparity
        del words, shading, least, most, cell, outline

    slots = _Slots(number, source, room)
    return Layers(
        cells=on_device(cells),
        places=places,
        samples=Samples(
            index=slots.stored(*np.split(index, [len(disparity)])),
            disparity=slots.stored(disparity, beyond),
            radiance=slots.stored(look.radiance[: len(face)], look.radiance[len(face) :]),
            triangle=slots.stored_where_held(face, -1),
            links=slots.stored_where_held(links, 0),
            opacity=None if opacity is None else slots.stored(opacity),
            gloss=_gloss_samples(slots, scene, gloss, look, face),
        ),
        background=far,
        ranges=ranges,
        disparity_scale=jnp.asarray(scale, dtype=real),
        lens=lens,
        camera=camera,
        grid=grid,
        complete=left_out == 0,
        left_out=LeftOut(left_out),
        pixel_filter=pixel_filter,
    )


def _ranges(
    cell: np.ndarray, least: np.ndarray, most: np.ndarray, scale: float, grid: Grid, real: np.dtype
) -> RangePyramid:
    """N-buffers of samples at places `cell` that span the steps `least` to `most`, for the widest blur."""
    return build_ranges(
        cell,
        least,
        most,
        scale,
        shape=(grid.rows, grid.columns),
        block=grid.supersampling,
        widest=2.0 * grid.margin + 4 * grid.supersampling,
        real=real,
    )


def _sizes(
    outline: "_Outline", grid: Grid, max_layers: int, like: Extent | None, *, spare: bool
) -> tuple[int, int]:
    """Numbers of layers and of places for samples; what is empty of them changes nothing."""
    kept = len(outline.index)
    # A few more than needed, so that few different numbers occur.
    needed = max(min(coarse_number(outline.layers, _LAYERS_STEP), max_layers), 1), _room(kept)
    count, room = sizes_like(*needed, like, spare=spare)
    if spare and not layers_fit(grid, min(count, max_layers), kept, room):
        # All that is won by it is time.
        count, room = sizes_like(*needed, like, spare=False)
    return min(count, max_layers), room


@dataclasses.dataclass(frozen=True)
class _Slots:
    """Where values of samples are stored.

    Attributes:
        number: slot [n] of each sample held and, after them, of the fringe samples.
        source: which of the samples held each fringe sample continues.
        room: number of slots.
    """

    number: np.ndarray
    source: np.ndarray
    room: int

    def stored(self, held: np.ndarray, fringe: np.ndarray | None = None) -> Array:
        """Values of the samples held and of the fringe: by default those of the surface it continues."""
        fringe = np.take(held, self.source, axis=0) if fringe is None else fringe
        return on_device(scattered((self.room,), self.number, np.concatenate([held, fringe])))

    def stored_where_held(self, held: np.ndarray, otherwise: int) -> Array:
        """Values of the samples held, and the same one everywhere else."""
        out = np.full(self.room, otherwise, dtype=held.dtype)
        out[self.number[: len(held)]] = held
        return on_device(out)


def _gloss_samples(
    slots: _Slots, scene: Scene, gloss: Gloss | None, look: ShadedSamples, face: np.ndarray
) -> GlossSamples | None:
    """Normals and materials of samples of the triangles `face`, if anything is glossy."""
    if gloss is None or look.normal is None:
        return None
    material = scene.face_material[face].astype(np.min_scalar_type(len(scene.materials) - 1))
    return GlossSamples(slots.stored(look.normal), slots.stored(material), gloss)


def _room(count: int) -> int:
    """Places for `count` samples and some more, so that few different numbers occur.

    Up to half as many more, and of many up to an eighth: memory is dearer then than time to compile.
    """
    finer = 2 if count <= _MANY else 4
    step = max(_LEAST_ROOM, 1 << max(count.bit_length() - finer, 0))
    return -(-max(count, 1) // step) * step


@dataclasses.dataclass(frozen=True)
class _Outline:
    """The samples held and, after them, the fringe samples that found room.

    Attributes:
        layers: number of layers that they take.
        index: flat index [n] of all.
        low: least disparity [n] that each spans.
        high: largest disparity [n].
        line: code [n] of what bounds the surface.
        links: which neighbours continue the surface, of the samples held.
        source: which of the samples held each fringe sample continues.
        disparity: 1/m of the fringe samples.
    """

    layers: int
    index: np.ndarray
    low: np.ndarray
    high: np.ndarray
    line: np.ndarray
    links: np.ndarray
    source: np.ndarray
    disparity: np.ndarray


def _outlined(
    held: Rasterised,
    counts: Sequence[int],
    surface: SurfaceSamples,
    parallax: float,
    max_layers: int,
    real: np.dtype,
) -> _Outline:
    """How samples continue one another, and where surfaces end."""
    grid, fragments = held.grid, held.fragments
    planes = Planes(
        (max(1, len(counts)), grid.rows, grid.columns),
        np.repeat(np.arange(len(counts), dtype=np.int32) * grid.size, counts) + fragments.sample,
        *(a.astype(real, copy=False) for a in (fragments.disparity, surface.slope_x, surface.slope_y)),
    )
    joins = join(planes, parallax)
    return_freed(sum(counts))
    fringe = find_silhouettes(held.triangles, grid, planes, joins, parallax)
    return_freed(sum(counts))
    return _with_fringe(planes, grid.size, joins, fringe, max_layers)


def _with_fringe(planes: Planes, size: int, joins: Joins, fringe: Silhouettes, max_layers: int) -> _Outline:
    """Fringe samples put into the first free layers at their grid samples, of which there are `size`."""
    filled = np.bincount(planes.held % size, minlength=size)
    order = np.argsort(fringe.cell, kind="stable")
    cell = fringe.cell[order]
    run = np.flatnonzero(np.diff(cell, prepend=-1))
    rank = np.arange(len(cell)) - np.repeat(run, np.diff(run, append=len(cell)))
    layer = filled[cell] + rank
    room = np.flatnonzero(layer < max_layers)
    added = order[room]
    whole = np.full(len(planes.held), WHOLE, dtype=np.uint16)
    whole[fringe.cut] = fringe.line
    return _Outline(
        layers=max(planes.shape[0], int(layer[room].max(initial=0)) + 1),
        index=np.concatenate([planes.held, (layer[room] * size + cell[room]).astype(np.int32)]),
        low=np.concatenate([joins.low, fringe.low[added]]),
        high=np.concatenate([joins.high, fringe.high[added]]),
        line=np.concatenate([whole, fringe.fringe_line[added]]),
        links=joins.links,
        source=fringe.source[added].astype(np.int32),
        disparity=fringe.disparity[added],
    )
