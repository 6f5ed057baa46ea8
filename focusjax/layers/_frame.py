"""The grid that a picture's layers need, and the triangles that matter on it."""

from collections.abc import Callable

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from focusjax._arguments import ArgumentError, real_number, require_kind
from focusjax._device import device_array
from focusjax._programs import jit
from focusjax.geometry import Camera, filter_radius
from focusjax.layers._blocks import coarse_number, pad_rows, padded_length
from focusjax.layers._clip import ScreenTriangles, clip_to_near
from focusjax.layers._grid import Grid, homogeneous_image
from focusjax.layers._margin import leaving, needed_margin, reachable
from focusjax.lens import AbstractLens, require_lens
from focusjax.scene import MOST_PIXELS, ConstantBackground, Scene

_BORDER = 2.0
"""Samples beyond the farthest ray: half a sample of rounding, one for bilinear, and some to spare."""
_MARGIN_STEP = 32
"""Margins above this are multiples of it, in pixels; narrower ones are powers of two. So a lens that moves a
little keeps the shapes that programs are compiled for."""
_LEAST_MARGIN = 8


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
