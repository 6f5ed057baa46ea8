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
from focusjax.layers._joins import Joins, Planes, join
from focusjax.layers._layers import Layers
from focusjax.layers._opacity import with_opacity
from focusjax.layers._pyramid import build_ranges
from focusjax.layers._raster import Fragments, rasterise
from focusjax.layers._shading import background, shaded
from focusjax.layers._silhouettes import Silhouettes, find_silhouettes
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
        outline = _with_fringe(len(owner), grid.size, joins, fringe, max_layers)
        words, scale = pack_cells(outline.low, outline.high, outline.line)
        ranges = build_ranges(
            outline.index % grid.size,
            outline.low,
            outline.high,
            shape=(grid.rows, grid.columns),
            block=supersampling,
            widest=2.0 * grid.margin + 4 * supersampling,
        )
        far = background(scene, camera, grid)
        look = shading.result()

    shape = (max(outline.layers, min(least_layers, max_layers)), grid.rows, grid.columns)

    def stored(samples: np.ndarray) -> Array:
        return on_device(scattered(shape, outline.index, samples))

    def with_fringe(samples: np.ndarray) -> np.ndarray:
        """Values of the samples held, and after them those of the fringe: of the surface it continues."""
        return np.concatenate([samples, samples[fringe.source[outline.added]]])

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
        disparity=stored(np.concatenate([disparity, fringe.disparity[outline.added]])),
        radiance=stored(with_fringe(look.radiance)),
        triangle=on_device(triangle),
        cells=stored(words),
        links=stored(np.concatenate([joins.links, np.zeros(len(outline.added), dtype=np.uint32)])),
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


def _with_fringe(layers: int, size: int, joins: Joins, fringe: Silhouettes, max_layers: int) -> _Outline:
    """Fringe samples put into the first free layers at their grid samples, of which there are `size`."""
    filled = np.bincount(joins.held % size, minlength=size)
    order = np.argsort(fringe.cell, kind="stable")
    cell = fringe.cell[order]
    run = np.flatnonzero(np.diff(cell, prepend=-1))
    rank = np.arange(len(cell)) - np.repeat(run, np.diff(run, append=len(cell)))
    layer = filled[cell] + rank
    room = np.flatnonzero(layer < max_layers)
    added = order[room]
    whole = np.full(len(joins.held), WHOLE, dtype=np.uint16)
    whole[fringe.cut] = fringe.line
    return _Outline(
        layers=max(layers, int(layer[room].max(initial=0)) + 1),
        added=added,
        index=np.concatenate([joins.held, layer[room] * size + cell[room]]),
        low=np.concatenate([joins.low, fringe.low[added]]),
        high=np.concatenate([joins.high, fringe.high[added]]),
        line=np.concatenate([whole, fringe.fringe_line[added]]),
    )
