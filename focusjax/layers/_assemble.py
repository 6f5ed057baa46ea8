"""From the fragments chosen for each layer to `Layers`: attributes, joins, silhouettes, shading."""

import concurrent.futures
import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from focusjax.geometry import Camera
from focusjax.layers._attributes import surface_samples
from focusjax.layers._cells import WHOLE, pack_cells
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._gloss import GlossSamples
from focusjax.layers._grid import Grid
from focusjax.layers._joins import Planes, join
from focusjax.layers._layers import Layers
from focusjax.layers._opacity import with_opacity
from focusjax.layers._pyramid import build_ranges
from focusjax.layers._raster import Fragments, rasterise
from focusjax.layers._shading import background, shaded
from focusjax.layers._silhouettes import find_silhouettes
from focusjax.layers._stamps import Stamps, dice
from focusjax.layers._store import on_device, scattered
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
    least_layers: int = 1,
    view_dependent: bool = False,
) -> Layers:
    """Layers of the fragments `chosen`, an index [h, w] for each layer, -1 where there is none."""
    gloss = scene.gloss() if view_dependent else None
    triangles, grid, stamps, fragments = picture.triangles, picture.grid, picture.stamps, picture.fragments
    supersampling, parallax = grid.supersampling, float(lens.parallax(camera)) * grid.supersampling
    owner = np.stack(chosen) if chosen else np.full((1, grid.rows, grid.columns), -1)
    held = np.flatnonzero(owner >= 0)
    fragment = owner.reshape(-1)[held]
    surface = surface_samples(stamps, triangles, fragments.sample[fragment], fragments.stamp[fragment], grid)
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
        slopes = surface.slope.astype(real)
        planes = Planes(*(scattered(owner.shape, held, a) for a in (disparity, *slopes.T)))
        joins = join(planes, parallax)
        fringe = find_silhouettes(triangles, grid, planes, joins, parallax)
        count, place, added = _free_places(len(owner), grid.size, held, fringe.cell, max_layers)
        count = max(count, min(least_layers, max_layers))
        source = fringe.source[added]
        index = np.concatenate([held, place])
        low = np.concatenate([joins.low, fringe.low[added]])
        high = np.concatenate([joins.high, fringe.high[added]])
        line = np.full(len(index), WHOLE, dtype=np.uint16)
        line[fringe.cut] = fringe.line
        line[len(held) :] = fringe.fringe_line[added]
        words, scale = pack_cells(low, high, line)
        ranges = build_ranges(
            index % grid.size,
            low,
            high,
            shape=(grid.rows, grid.columns),
            block=supersampling,
            widest=2.0 * grid.margin + 4 * supersampling,
        )
        far = background(scene, camera, grid)
        look = shading.result()

    shape = (count, grid.rows, grid.columns)

    def stored(samples: np.ndarray) -> Array:
        return on_device(scattered(shape, index, samples))

    def with_fringe(samples: np.ndarray) -> np.ndarray:
        """Values of the samples held, and after them those of the fringe: of the surface it continues."""
        return np.concatenate([samples, samples[source]])

    gloss_samples = None
    if gloss is not None and look.normal is not None:
        number = np.min_scalar_type(len(scene.materials) - 1)
        gloss_samples = GlossSamples(
            normal=stored(with_fringe(look.normal)),
            material=stored(with_fringe(scene.face_material[surface.face].astype(number))),
            model=gloss,
        )
    opacity = None
    if picture.opacity is not None:
        opacity = stored(with_fringe(picture.opacity[fragment].astype(real)))
    triangle = np.full(shape, -1, dtype=np.int32)
    triangle.reshape(-1)[held] = surface.face
    return Layers(
        disparity=stored(np.concatenate([disparity, fringe.disparity[added]])),
        radiance=stored(with_fringe(look.radiance)),
        triangle=on_device(triangle),
        cells=stored(words),
        links=stored(np.concatenate([joins.links, np.zeros(len(place), dtype=np.uint32)])),
        opacity=opacity,
        background=far,
        ranges=ranges,
        disparity_scale=jnp.asarray(scale, dtype=real),
        lens=lens,
        camera=camera,
        grid=grid,
        complete=complete,
        gloss=gloss_samples,
    )


def _free_places(
    layers: int, size: int, held: np.ndarray, cell: np.ndarray, max_layers: int
) -> tuple[int, np.ndarray, np.ndarray]:
    """First free layers for samples to add at the grid samples `cell`.

    Returns:
        the number of layers, the flat place of each sample that found room, and which those are.
    """
    filled = np.bincount(held % size, minlength=size)
    order = np.argsort(cell, kind="stable")
    sorted_cell = cell[order]
    run = np.flatnonzero(np.diff(sorted_cell, prepend=-1))
    rank = np.arange(len(cell)) - np.repeat(run, np.diff(run, append=len(cell)))
    layer = filled[sorted_cell] + rank
    room = np.flatnonzero(layer < max_layers)
    count = max(layers, int(layer[room].max(initial=0)) + 1)
    return count, layer[room] * size + sorted_cell[room], order[room]
