"""From the fragments chosen for each layer to `Layers`: attributes, joins, silhouettes, shading."""

import concurrent.futures
import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from focusjax.geometry import Camera
from focusjax.layers._attributes import surface_samples
from focusjax.layers._cells import WHOLE, in_steps, pack_cells
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._extent import Extent
from focusjax.layers._gloss import GlossSamples
from focusjax.layers._grid import Grid
from focusjax.layers._joins import Joins, Planes, join
from focusjax.layers._layers import Layers, Samples
from focusjax.layers._opacity import with_opacity
from focusjax.layers._places import make_places
from focusjax.layers._pyramid import build_ranges
from focusjax.layers._raster import Fragments, rasterise
from focusjax.layers._shading import background, shaded
from focusjax.layers._silhouettes import Silhouettes, find_silhouettes
from focusjax.layers._stamps import Stamps, dice
from focusjax.layers._store import on_device, scattered
from focusjax.lens import AbstractLens
from focusjax.scene import Scene

_LEAST_ROOM = 1 << 10


@dataclasses.dataclass(frozen=True)
class Rasterised:
    """Triangles on a grid, all that they cover there, and how much of it is there (None: all of it)."""

    triangles: ScreenTriangles
    grid: Grid
    stamps: Stamps
    fragments: Fragments
    opacity: np.ndarray | None


def rasterised(scene: Scene, camera: Camera, triangles: ScreenTriangles, grid: Grid) -> Rasterised:
    """Everything that `triangles` of `scene` cover on `grid`."""
    stamps = dice(triangles, grid)
    covered = rasterise(stamps, grid)
    return Rasterised(triangles, grid, stamps, *with_opacity(scene, camera, triangles, grid, stamps, covered))


def margin_like(like: Extent | None, camera: Camera, supersampling: int) -> int:
    """The margin in samples of layers to be like, 0 if there are none.

    Raises:
        ValueError: they are of another frame.
    """
    if like is None:
        return 0
    theirs, ours = (
        (grid.width, grid.height, grid.supersampling)
        for grid in (like.grid, Grid(camera.width, camera.height, supersampling, 0))
    )
    if theirs != ours:
        raise ValueError(
            f"the layers to be like are of {theirs[0]} x {theirs[1]} pixels at a supersampling of"
            f" {theirs[2]}; expected {ours[0]} x {ours[1]} at {ours[2]}, so leave `like` out"
        )
    return like.grid.margin


def assemble(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    picture: Rasterised,
    chosen: Sequence[Int[np.ndarray, " _"]],
    *,
    max_layers: int,
    complete: bool,
    like: Extent | None = None,
    view_dependent: bool = False,
) -> Layers:
    """Layers of the fragments `chosen` for each, in the order of their samples."""
    gloss = scene.gloss() if view_dependent else None
    triangles, grid, fragments = picture.triangles, picture.grid, picture.fragments
    supersampling, parallax = grid.supersampling, float(lens.parallax(camera)) * grid.supersampling
    fragment = np.concatenate([np.zeros(0, dtype=np.intp), *chosen])
    sample = fragments.sample[fragment]
    layer = np.repeat(np.arange(len(chosen)), [len(some) for some in chosen])
    surface = surface_samples(picture.stamps, triangles, sample, fragments.stamp[fragment], grid)
    real = np.zeros(0, dtype=jnp.zeros(()).dtype).dtype
    disparity = fragments.disparity[fragment].astype(real)

    # Shading and the geometry need nothing of each other: while one compiles or waits, the other works.
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        extent_m = 1.0 / (disparity * float(camera.focal_px) * supersampling)
        shading = pool.submit(
            shaded,
            scene.shader(camera.position),
            surface.face,
            surface.barycentric,
            extent_m,
            gloss_apart=gloss is not None,
        )
        shape = (max(1, len(chosen)), grid.rows, grid.columns)
        slopes = surface.slope_x.astype(real), surface.slope_y.astype(real)
        planes = Planes(shape, layer * grid.size + sample, disparity, *slopes)
        joins = join(planes, parallax)
        fringe = find_silhouettes(triangles, grid, planes, joins, parallax)
        outline = _with_fringe(planes, grid.size, joins, fringe, max_layers)
        least, most, scale = in_steps(outline.low, outline.high)
        ranges = build_ranges(
            outline.index % grid.size,
            least,
            most,
            scale,
            shape=(grid.rows, grid.columns),
            block=supersampling,
            widest=2.0 * grid.margin + 4 * supersampling,
            real=real,
        )
        count = max(outline.layers, 1 if like is None else min(like.count, max_layers))
        shape = (count, grid.rows, grid.columns)
        cells = scattered(shape, outline.index, pack_cells(least, most, outline.line))
        places, number = make_places(count * grid.size, outline.index)
        far = background(scene, camera, grid)
        look = shading.result()

    room = _room(len(number))
    if like is not None:
        room = max(room, like.room)
    source = fringe.source[outline.added]

    def stored(held: np.ndarray, added: np.ndarray | None = None) -> Array:
        """Values of the samples held and of the fringe: by default those of the surface it continues."""
        added = np.take(held, source, axis=0) if added is None else added
        return on_device(scattered((room,), number, np.concatenate([held, added])))

    gloss_samples = None
    if gloss is not None and look.normal is not None:
        smallest = np.min_scalar_type(len(scene.materials) - 1)
        material = scene.face_material[surface.face].astype(smallest)
        gloss_samples = GlossSamples(stored(look.normal), stored(material), gloss)
    triangle = np.full(room, -1, dtype=np.int32)
    triangle[number[: len(surface.face)]] = surface.face
    samples = Samples(
        disparity=stored(disparity, fringe.disparity[outline.added]),
        radiance=stored(look.radiance),
        triangle=on_device(triangle),
        links=stored(joins.links, np.zeros(len(source), dtype=np.uint32)),
        opacity=None if picture.opacity is None else stored(picture.opacity[fragment].astype(real)),
        gloss=gloss_samples,
    )
    return Layers(
        cells=on_device(cells),
        places=places,
        samples=samples,
        background=far,
        ranges=ranges,
        disparity_scale=jnp.asarray(scale, dtype=real),
        lens=lens,
        camera=camera,
        grid=grid,
        complete=complete,
    )


def _room(count: int) -> int:
    """Places for `count` samples and up to an eighth more: a number that few different counts have."""
    step = max(_LEAST_ROOM, 1 << max(count.bit_length() - 4, 0))
    return -(-max(count, 1) // step) * step


@dataclasses.dataclass(frozen=True)
class _Outline:
    """The samples held and, after them, the fringe samples that found room.

    Attributes:
        layers: number of layers that they take.
        added: which of the fringe samples found room.
        index: flat index [n] of all.
        low: least disparity [n] that each spans.
        high: largest disparity [n].
        line: code [n] of what bounds the surface.
    """

    layers: int
    added: np.ndarray
    index: np.ndarray
    low: np.ndarray
    high: np.ndarray
    line: np.ndarray


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
        added=added,
        index=np.concatenate([planes.held, layer[room] * size + cell[room]]),
        low=np.concatenate([joins.low, fringe.low[added]]),
        high=np.concatenate([joins.high, fringe.high[added]]),
        line=np.concatenate([whole, fringe.fringe_line[added]]),
    )
