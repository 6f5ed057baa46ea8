"""From the fragments chosen for each layer to `Layers`: attributes, joins, silhouettes, shading."""

import concurrent.futures
import dataclasses
import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from focusjax.geometry import Camera
from focusjax.layers._attributes import surface_samples
from focusjax.layers._cells import WHOLE, pack_cells
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid
from focusjax.layers._joins import ALL_UNJOINED, Planes, join
from focusjax.layers._layers import Layers
from focusjax.layers._opacity import with_opacity
from focusjax.layers._pyramid import build_ranges
from focusjax.layers._raster import Fragments, rasterise
from focusjax.layers._shading import background, shaded
from focusjax.layers._silhouettes import find_silhouettes
from focusjax.layers._stamps import Stamps, dice
from focusjax.lens import AbstractLens
from focusjax.scene import Scene


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


def assemble(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    picture: Rasterised,
    chosen: Sequence[np.ndarray],
    *,
    max_layers: int,
    complete: bool,
) -> Layers:
    """Layers of the fragments `chosen`, an index [h, w] for each layer, -1 where there is none."""
    triangles, grid, stamps, fragments = picture.triangles, picture.grid, picture.stamps, picture.fragments
    supersampling, parallax = grid.supersampling, float(lens.parallax(camera)) * grid.supersampling
    owner = np.stack(chosen) if chosen else np.full((1, grid.rows, grid.columns), -1)
    held = np.flatnonzero(owner >= 0)
    fragment = owner.reshape(-1)[held]
    surface = surface_samples(stamps, triangles, fragments.sample[fragment], fragments.stamp[fragment], grid)
    real = np.zeros(0, dtype=jnp.zeros(()).dtype).dtype
    values = fragments.disparity[fragment]

    # Shading and the geometry need nothing of each other: while one compiles or waits, the other works.
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        extent_m = 1.0 / (values * float(camera.focal_px) * supersampling)
        shading = pool.submit(
            shaded, scene.shader(camera.position), surface.face, surface.barycentric, extent_m
        )
        planes = Planes(*(_scattered(owner.shape, held, a, 0.0, real) for a in (values, *surface.slope.T)))
        joins = join(planes, parallax)
        edges = find_silhouettes(triangles, grid, planes, joins, parallax)
        count, place, added = _free_places(planes.disparity, edges.cell, max_layers)
        shape = (count, *owner.shape[1:])

        def extended(samples: np.ndarray, fringe: np.ndarray, fill: float) -> np.ndarray:
            flat = np.full((count * grid.size, *samples.shape[3:]), fill, dtype=samples.dtype)
            flat[: owner.size] = samples.reshape(owner.size, *samples.shape[3:])
            flat[place] = fringe[added]
            return flat.reshape(*shape, *samples.shape[3:])

        low = jnp.asarray(extended(joins.low, edges.low, 0.0))
        high = jnp.asarray(extended(joins.high, edges.high, 0.0))
        line = np.full(owner.size, WHOLE, dtype=np.uint16)
        line[edges.cut] = edges.line
        line = extended(line.reshape(owner.shape), edges.fringe_line, WHOLE)
        cells, scale = pack_cells(low, high, jnp.asarray(line))
        ranges = build_ranges(low, high, block=supersampling, widest=2.0 * grid.margin + 4 * supersampling)
        far = background(scene, camera, grid)
        radiance = _scattered(owner.shape, held, shading.result(), 0.0, real)
    unjoined = np.full(len(edges.cell), ALL_UNJOINED, dtype=np.uint32)
    nowhere = np.full(len(edges.cell), -1, dtype=np.int32)
    triangle = _scattered(owner.shape, held, surface.face, -1, np.dtype(np.int32))
    opacity = None
    if picture.opacity is not None:
        share = _scattered(owner.shape, held, picture.opacity[fragment], 0.0, real)
        opacity = jnp.asarray(extended(share, share.reshape(-1)[edges.source], 0.0))
    return Layers(
        disparity=jnp.asarray(extended(planes.disparity, edges.disparity, 0.0)),
        radiance=jnp.asarray(extended(radiance, radiance.reshape(-1, 3)[edges.source], 0.0)),
        triangle=jnp.asarray(extended(triangle, nowhere, -1)),
        cells=cells,
        links=jnp.asarray(extended(joins.links, unjoined, ALL_UNJOINED)),
        opacity=opacity,
        background=far,
        ranges=ranges,
        disparity_scale=scale,
        lens=lens,
        camera=camera,
        grid=grid,
        complete=complete,
    )


def _scattered(
    shape: tuple[int, ...], index: np.ndarray, samples: np.ndarray, fill: float, dtype: np.dtype
) -> np.ndarray:
    """`samples` [n, ...] at the flat places `index` of an array of `shape`, `fill` elsewhere."""
    flat = np.full((math.prod(shape), *samples.shape[1:]), fill, dtype=dtype)
    flat[index] = samples
    return flat.reshape(*shape, *samples.shape[1:])


def _free_places(
    disparity: np.ndarray, cell: np.ndarray, max_layers: int
) -> tuple[int, np.ndarray, np.ndarray]:
    """First free layers for samples to add at the grid samples `cell`.

    Returns:
        the number of layers, the flat place of each sample that found room, and which those are.
    """
    filled = np.count_nonzero(disparity, axis=0).reshape(-1)
    order = np.argsort(cell, kind="stable")
    sorted_cell = cell[order]
    run = np.flatnonzero(np.diff(sorted_cell, prepend=-1))
    rank = np.arange(len(cell)) - np.repeat(run, np.diff(run, append=len(cell)))
    layer = filled[sorted_cell] + rank
    room = np.flatnonzero(layer < max_layers)
    count = max(len(disparity), int(layer[room].max(initial=0)) + 1)
    return count, layer[room] * disparity[0].size + sorted_cell[room], order[room]
