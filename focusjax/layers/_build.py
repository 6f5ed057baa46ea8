"""From a scene, a camera and a lens to layers: clip, frame, rasterise, peel, shade, join."""

import concurrent.futures
import math
import os
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera
from focusjax.layers._attributes import surface_samples
from focusjax.layers._cells import WHOLE, pack_cells
from focusjax.layers._clip import ScreenTriangles, clip_to_near
from focusjax.layers._grid import Grid, homogeneous_image
from focusjax.layers._joins import ALL_UNJOINED, Planes, join
from focusjax.layers._layers import Layers
from focusjax.layers._margin import needed_margin, reachable
from focusjax.layers._peel import peel_fragments
from focusjax.layers._pyramid import build_ranges
from focusjax.layers._raster import rasterise
from focusjax.layers._silhouettes import find_silhouettes
from focusjax.layers._stamps import dice, pad_rows, padded_length
from focusjax.lens import AbstractLens
from focusjax.scene import AbstractBackground, ConstantBackground, Scene, Shader

_MOST_SAMPLES = 1 << 27
_BORDER = 2.0
"""Samples beyond the farthest ray: half a pixel of filter, half a sample of rounding, one for bilinear."""
_SHADED_AT_ONCE = 1 << 18
_MARGIN_STEP = 8


def peel(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    *,
    supersampling: int = 2,
    max_layers: int = 8,
    near: float | None = None,
) -> Layers:
    """Every surface that a ray of `lens` can reach, as layers seen from the lens centre.

    Args:
        scene: what is in front of the camera.
        camera: frame and pose.
        lens: the layers serve it and every lens whose rays stay within its own.
        supersampling: layer samples per output pixel and axis. Two keep edges in focus clean;
            one is quicker where all is blurred.
        max_layers: stop here; `complete` on the result says whether more was left.
        near: depth in metres from which surfaces count; a tenth of the focal length if not given.

    Raises:
        ValueError: a count below 1, or a surface so close to the lens that the margin its blur needs
            does not fit in memory.
    """
    for name, value in (("supersampling", supersampling), ("max_layers", max_layers)):
        if value < 1:
            raise ValueError(f"{name} is {value}; expected at least 1")
    parallax = float(lens.parallax(camera)) * supersampling
    triangles, grid = _frame(scene, camera, lens, supersampling, near)
    stamps = dice(triangles, grid)
    fragments = rasterise(stamps, grid)
    chosen, complete = peel_fragments(fragments, grid, parallax, max_layers)
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
            _shaded, scene.shader(camera.position), surface.face, surface.barycentric, extent_m
        )
        planes = Planes(*(_scattered(owner.shape, held, a, 0.0, real) for a in (values, *surface.slope.T)))
        joins = join(planes, parallax)
        edges = find_silhouettes(triangles, grid, planes, joins, parallax)
        count, place, added = _free_places(planes.disparity, edges.cell, max_layers)
        shape = (count, grid.rows, grid.columns)

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
        background = _background(scene, camera, grid)
        radiance = _scattered(owner.shape, held, shading.result(), 0.0, real)
    unjoined = np.full(len(edges.cell), ALL_UNJOINED, dtype=np.uint32)
    nowhere = np.full(len(edges.cell), -1, dtype=np.int32)
    triangle = _scattered(owner.shape, held, surface.face, -1, np.dtype(np.int32))
    return Layers(
        disparity=jnp.asarray(extended(planes.disparity, edges.disparity, 0.0)),
        radiance=jnp.asarray(extended(radiance, radiance.reshape(-1, 3)[edges.source], 0.0)),
        triangle=jnp.asarray(extended(triangle, nowhere, -1)),
        cells=cells,
        links=jnp.asarray(extended(joins.links, unjoined, ALL_UNJOINED)),
        background=background,
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


def disparity_map(scene: Scene, camera: Camera) -> np.ndarray:
    """Disparity in 1/m [h, w] of the first surface at every pixel centre; 0 where there is none."""
    triangles, grid = _frame(scene, camera, None, 1, None)
    fragments = rasterise(dice(triangles, grid), grid)
    chosen, _ = peel_fragments(fragments, grid, 0.0, 1)
    out = np.zeros((grid.rows, grid.columns))
    for owner in chosen:
        out[owner >= 0] = fragments.disparity[owner[owner >= 0]]
    return out


def _frame(
    scene: Scene, camera: Camera, lens: AbstractLens | None, supersampling: int, near: float | None
) -> tuple[ScreenTriangles, Grid]:
    """The triangles that matter, in the coordinates of the grid that holds them."""
    frame = Grid(camera.width, camera.height, supersampling, 0)
    if frame.size > _MOST_SAMPLES:
        raise ValueError(
            f"a frame of {camera.width} x {camera.height} pixels needs {frame.size / 1e6:.0f} million samples"
            f" a layer at a supersampling of {supersampling}; the most is {_MOST_SAMPLES / 1e6:.0f} million,"
            " so lower one of them"
        )
    depth = 0.1 * float(camera.focal_length) if near is None else near
    if not depth > 0:
        raise ValueError(f"near is {near} m; expected a positive depth")
    triangles = clip_to_near(homogeneous_image(scene.vertices, camera, frame), scene.faces, depth)
    reach = _reach(lens, camera, supersampling)
    triangles = triangles.take(np.flatnonzero(reachable(triangles, frame, reach)))
    margin = 0
    if lens is not None and float(lens.parallax(camera)) > 0:
        widest = needed_margin(triangles, frame, reach)
        if not isinstance(scene.background, ConstantBackground):
            widest = max(widest, float(reach(np.zeros(1))[0]))
        # One empty ring more, so that a ray outside the grid is told of nothing.
        margin = int(np.ceil(widest)) + 1
        # Whole pixels, so that blocks of the range pyramid line up with them, and coarse steps, so
        # that a small change of the lens keeps the shapes that are already compiled.
        step = _MARGIN_STEP * supersampling
        margin = -(-margin // step) * step
    grid = Grid(camera.width, camera.height, supersampling, margin)
    if grid.size > _MOST_SAMPLES:
        raise ValueError(
            f"rays leave the {camera.width} x {camera.height} frame by {margin / supersampling:.0f} pixels,"
            " more than the layers can hold; move the nearest surface away from the lens, raise `near`, close"
            " the aperture, or lower the supersampling"
        )
    triangles.corners[..., :2] += margin
    return triangles, grid


def _reach(
    lens: AbstractLens | None, camera: Camera, supersampling: int
) -> Callable[[np.ndarray], np.ndarray]:
    """How far in samples rays of any film point stray from it, as a function of disparities."""
    if lens is None:
        return np.zeros_like
    films = jnp.array(
        [[x * camera.width, y * camera.height] for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0)]
    )

    def reach(disparity: np.ndarray) -> np.ndarray:
        flat = pad_rows(disparity.reshape(-1), max(1024, padded_length(disparity.size)))
        radius = np.asarray(_footprints(lens, camera, films, jnp.asarray(flat, dtype=films.dtype)))
        return radius[: disparity.size].reshape(disparity.shape) * supersampling + supersampling / 2 + _BORDER

    return reach


@eqx.filter_jit
def _footprints(
    lens: AbstractLens, camera: Camera, films: Float[Array, "p 2"], disparity: Float[Array, " t"]
) -> Float[Array, " t"]:
    """Largest distance of any ray from its own film point, over the film points."""

    def one(film: Float[Array, "2"], w: Float[Array, ""]) -> Float[Array, ""]:
        centre, radius = lens.footprint(camera, film, w)
        return radius + jnp.abs(centre - film).max()

    return jax.vmap(lambda w: jax.vmap(lambda p: one(p, w))(films).max())(disparity)


@eqx.filter_jit
def _shade_block(
    shader: Shader, face: Int[Array, " n"], barycentric: Float[Array, "n 3"], extent: Float[Array, " n"]
) -> Float[Array, "n 3"]:
    # Blocks that fit the cache: look-ups of a million samples at once would spill it.
    return jax.lax.map(lambda sample: shader(*sample), (face, barycentric, extent), batch_size=4096)


def _shaded(shader: Shader, face: np.ndarray, barycentric: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """Radiance [n, 3] of the surface samples."""
    real = jnp.zeros(()).dtype

    def block(start: int) -> np.ndarray:
        part = slice(start, start + _SHADED_AT_ONCE)
        inputs = [
            pad_rows(a[part], _SHADED_AT_ONCE) for a in (face, barycentric.astype(real), extent.astype(real))
        ]
        shaded = _shade_block(shader, *(jnp.asarray(a) for a in inputs))
        return np.asarray(shaded)[: len(face) - start]

    # The blocks are scanned, which XLA does on one core: a CPU is given one per core at a time.
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        parts = list(pool.map(block, range(0, len(face), _SHADED_AT_ONCE)))
    return np.concatenate([np.zeros((0, 3), dtype=real), *parts])


@eqx.filter_jit
def _background_radiance(
    background: AbstractBackground, camera: Camera, positions: Float[Array, "n 2"]
) -> Float[Array, "n 3"]:
    return jax.vmap(lambda xy: background.radiance(camera.direction(xy)))(positions)


def _background(scene: Scene, camera: Camera, grid: Grid) -> Float[Array, "h w 3"]:
    """What is seen at infinity through every sample of the grid."""
    if isinstance(scene.background, ConstantBackground):
        colour = np.asarray(scene.background.colour)
        return jnp.asarray(np.broadcast_to(colour, (grid.rows, grid.columns, 3)))
    x, y = np.meshgrid(np.arange(grid.columns) + 0.5, np.arange(grid.rows) + 0.5)
    positions = (np.stack([x, y], axis=-1).reshape(-1, 2) - grid.margin) / grid.supersampling
    flat = _background_radiance(scene.background, camera, jnp.asarray(positions, dtype=float))
    return flat.reshape(grid.rows, grid.columns, 3)
