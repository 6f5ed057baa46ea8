"""The grid that a picture's layers need, and the triangles that matter on it.

A ray of a film point leaves it, at disparity w, by at most the lens's footprint radius r(w). So a surface
point outside the frame matters exactly when its distance to the frame is within r(w), and layers must reach
that far beyond the picture's border.
"""

from collections.abc import Callable

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from focusjax._arguments import ArgumentError, real_number, require_kind
from focusjax._device import device_array
from focusjax._parallel import in_parallel, parts
from focusjax._programs import jit
from focusjax.geometry import Camera, filter_radius
from focusjax.layers._blocks import coarse_number, pad_rows, padded_length
from focusjax.layers._clip import ScreenTriangles, clip_to_near
from focusjax.layers._grid import Grid, homogeneous_image
from focusjax.lens import AbstractLens, require_lens
from focusjax.scene import MOST_PIXELS, ConstantBackground, Scene

_BORDER = 2.0
"""Samples beyond the farthest ray: half a sample of rounding, one for bilinear, and some to spare."""
_MARGIN_STEP = 32
"""Margins above this are multiples of it, in pixels; narrower ones are powers of two. So a lens that moves a
little keeps the shapes that programs are compiled for."""
_LEAST_MARGIN = 8
_ROUNDS = 40
_MOST_PIECES = 200_000
_AT_ONCE = 1 << 17
_SLACK = 1.0
"""Samples by which the answer may be too large; never too small."""


def frame(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens | None,
    supersampling: int,
    near: float | None,
    *,
    least_margin: int = 0,
    pixel_filter: str = "box",
) -> tuple[ScreenTriangles, Grid]:
    """The triangles that matter, in the coordinates of the grid that holds them."""
    usage = "layers of (scene, camera, lens)"
    require_kind(scene, Scene, usage, "`make_scene` makes one", "scene")
    require_kind(camera, Camera, usage, "`look_at` and `make_camera` make one", "camera")
    if lens is not None:
        require_lens(lens, usage, beyond_infinity=True)
    # Compiled functions trace what is worked out of known cameras, too.
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((camera, camera.focal_px, lens))):
        raise ArgumentError(
            f"{usage} are made within a function that JAX compiles, maps or differentiates, but how much they"
            " hold has to be known; make them outside of it, for the lens whose rays go farthest",
            "lens",
        )
    inner = Grid(camera.width, camera.height, supersampling, 0)
    if inner.size > MOST_PIXELS:
        raise ValueError(
            f"a frame of {camera.width} x {camera.height} pixels needs {inner.size / 1e6:.0f} million samples"
            f" a layer at a supersampling of {supersampling}; the most is {MOST_PIXELS / 1e6:.0f} million,"
            " so lower one of them"
        )
    depth = 0.1 * float(camera.focal_length) if near is None else _near(near)
    triangles = clip_to_near(homogeneous_image(scene.vertices, camera, inner), scene.faces, depth)
    beyond = filter_radius(pixel_filter) - 0.5
    reach = _reach(lens, camera, supersampling, beyond)
    margin = least_margin
    crossing = leaving(triangles, inner)
    outside = triangles.take(crossing)
    if lens is not None and (beyond > 0 or float(lens.parallax(camera)) > 0):
        widest = needed_margin(outside.take(np.flatnonzero(reachable(outside, inner, reach))), inner, reach)
        if not isinstance(scene.background, ConstantBackground):
            widest = max(widest, float(reach(np.zeros(1))[0]))
        # One empty ring more, so that a ray outside the grid meets nothing.
        needed = int(np.ceil(widest)) + 1
        # Whole pixels, so that blocks of the range pyramid line up with them.
        pixels = -(-needed // supersampling)
        exact = supersampling * pixels
        wide = supersampling * max(_LEAST_MARGIN, coarse_number(pixels, _MARGIN_STEP))
        fits = Grid(camera.width, camera.height, supersampling, wide).size <= MOST_PIXELS
        margin = max(least_margin, wide if fits else exact)
    grid = Grid(camera.width, camera.height, supersampling, margin)
    if grid.size > MOST_PIXELS:
        raise ValueError(
            f"rays leave the {camera.width} x {camera.height} frame by {margin / supersampling:.0f} pixels,"
            " more than the layers can hold; move the nearest surface away from the lens, raise `near`, close"
            " the aperture, or lower the supersampling"
        )
    # All that the margin holds, not only what this lens reaches: another focus reaches other surfaces there.
    held = reachable(outside, inner, lambda disparity: np.full_like(disparity, margin))
    if not held.all():
        kept = np.ones(triangles.count, dtype=bool)
        kept[crossing] = held
        triangles = triangles.take(np.flatnonzero(kept))
    triangles.points[:, :2] += margin
    return triangles, grid


def _near(near: object) -> float:
    """The depth from which surfaces count, as a user gives it."""
    expected = "a positive depth in metres, or None for a tenth of the focal length"
    depth = real_number(near, "near", expected)
    if not 0 < depth < np.inf:
        raise ValueError(f"near is {near!r}; expected {expected}")
    return depth


def _reach(
    lens: AbstractLens | None, camera: Camera, supersampling: int, beyond: float
) -> Callable[[np.ndarray], np.ndarray]:
    """How far in samples rays of any pixel stray from the frame, as a function of disparities.

    Film points lie up to `beyond` pixels outside it.
    """
    if lens is None:
        return np.zeros_like

    def reach(disparity: np.ndarray) -> np.ndarray:
        flat = pad_rows(disparity.reshape(-1), max(1024, padded_length(disparity.size)))
        radius = np.asarray(_reaches(lens, camera, device_array(flat, dtype=camera.focal_px.dtype)))
        strays = radius[: disparity.size].reshape(disparity.shape) + beyond
        return strays * supersampling + supersampling / 2 + _BORDER

    return reach


@jit
def _reaches(lens: AbstractLens, camera: Camera, disparity: Float[Array, " t"]) -> Float[Array, " t"]:
    return jax.vmap(lambda w: lens.reach(camera, w))(disparity)


def leaving(triangles: ScreenTriangles, frame: Grid) -> np.ndarray:
    """Which triangles [n] have a corner outside the frame."""
    x, y = triangles.points[:, 0], triangles.points[:, 1]
    outside = (x < 0) | (x > frame.columns) | (y < 0) | (y > frame.rows)

    def some(part: slice) -> np.ndarray:
        first, second, third = (np.take(outside, corner[part]) for corner in triangles.faces.T)
        return part.start + np.flatnonzero(first | second | third)

    found = in_parallel(some, parts(triangles.count, _AT_ONCE))
    return np.concatenate([np.zeros(0, dtype=np.intp), *found])


def reachable(
    triangles: ScreenTriangles, frame: Grid, reach: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Mask [t] of the triangles, in grid coordinates of `frame`, whose bounding box some lens ray may touch.

    `reach` gives the footprint radius in samples for disparities: convex, as rays are lines in disparity.
    """

    def some(part: slice) -> np.ndarray:
        gap = _gap(triangles.span(0, part), triangles.span(1, part), frame)
        outside = np.flatnonzero(gap > 0)
        mask = gap <= 0
        corners = triangles.points[triangles.faces[part][outside]]
        mask[outside] = gap[outside] <= _widest_reach(corners, reach)
        return mask

    return np.concatenate([np.zeros(0, dtype=bool), *in_parallel(some, parts(triangles.count, _AT_ONCE))])


def needed_margin(
    triangles: ScreenTriangles, frame: Grid, reach: Callable[[np.ndarray], np.ndarray]
) -> float:
    """Samples of margin that hold every point of `triangles` that lens rays can reach.

    Corners give a lower bound and whole triangles an upper one; triangles that could still raise the
    bound are split in (x, y, w), where they stay flat, until the two bounds are within one
    sample. A ground plane that runs under the camera comes close to the lens, where blur is
    huge, but outside the frame by even more: only splitting shows whether rays reach it.
    """
    corners = triangles.take(leaving(triangles, frame)).corners
    best, upper = 0.0, np.zeros(0)
    for _ in range(_ROUNDS):
        if not len(corners):
            break
        outside = _distance_outside(corners, frame)
        radius = reach(corners[..., 2])
        best = max(best, float(np.max(np.where(outside <= radius, outside, 0.0))))
        least, widest = _overshoot_bounds(corners, frame), _widest_reach(corners, reach)
        upper = np.where(least <= widest, np.minimum(widest, outside.max(axis=1)), 0.0)
        corners, upper = corners[upper > best + _SLACK], upper[upper > best + _SLACK]
        if len(corners) > _MOST_PIECES:
            break
        corners = _split(corners)
    return max(best + _SLACK, float(upper.max(initial=0.0)))


def _distance_outside(points: np.ndarray, frame: Grid) -> np.ndarray:
    """Distance (max norm) of image points [..., 2+] from the frame; 0 inside."""
    x, y = points[..., 0], points[..., 1]
    wide, high = frame.columns, frame.rows
    return np.maximum.reduce([-x, x - wide, -y, y - high, np.zeros_like(x)])


def _overshoot_bounds(corners: np.ndarray, frame: Grid) -> np.ndarray:
    """Least distance from the frame over each triangle's bounding box [t]."""
    x, y = corners[..., 0], corners[..., 1]
    return _gap((-_most(-x), _most(x)), (-_most(-y), _most(y)), frame)


def _gap(x: tuple[np.ndarray, np.ndarray], y: tuple[np.ndarray, np.ndarray], frame: Grid) -> np.ndarray:
    """Distance (max norm) of boxes, given by least and largest x and y [t], from the frame."""
    across = np.maximum(-x[1], x[0] - frame.columns)
    down = np.maximum(-y[1], y[0] - frame.rows)
    return np.maximum(np.maximum(across, down), 0.0)


def _most(a: np.ndarray) -> np.ndarray:
    """Largest of the three columns; numpy's reduction over so short an axis is ten times slower."""
    return np.maximum(np.maximum(a[:, 0], a[:, 1]), a[:, 2])


def _widest_reach(corners: np.ndarray, reach: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Largest footprint radius over each triangle [t]; a convex function peaks at a corner."""
    return _most(reach(corners[..., 2]))


def _split(corners: np.ndarray) -> np.ndarray:
    """The two halves of each triangle [2 t, 3, 3], cut across its longest side on screen."""
    side = corners[:, [1, 2, 0]] - corners
    longest = np.argmax((side[..., :2] ** 2).sum(axis=-1), axis=1)
    order = (longest[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[..., None], axis=1), 1, 0)
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
