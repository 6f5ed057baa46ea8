"""Which fragments are there at all, and how much of each: alpha-tested leaves, panes of glass."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.layers._attributes import surface_samples
from focusjax.layers._blocks import in_blocks
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid
from focusjax.layers._raster import Fragments
from focusjax.layers._umbra import SEPARATION
from focusjax.scene import Opacity, Scene

LEVELS = 255
"""Opacities are kept in this many steps, as the tracer packs them into bytes."""
NEARER = 1.0 + 2.0 * SEPARATION
"""By which what may be seen through is put nearer: a decal is before the wall that it lies on."""
_AT_ONCE = 1 << 16


def with_opacity(
    scene: Scene,
    camera: Camera,
    triangles: ScreenTriangles,
    grid: Grid,
    fragments: Fragments,
) -> tuple[Fragments, Float[np.ndarray, " f"] | None]:
    """The fragments of which something is there, and the share [f], 0 to 1, of each that is.

    None stands for opaque all over, which costs nothing. An opacity is that of the square of its sample, so
    where a texture cuts a surface out inside a triangle, its outline is known to a share of the samples
    along it; the outline of the triangles is known better (see `_silhouettes`).

    What may be seen through is put a little nearer; see `NEARER`.
    """
    faces = scene.may_be_seen_through()
    if faces is None:
        return fragments, None
    asked = np.flatnonzero(faces[triangles.source][fragments.triangle])
    if not len(asked):
        return fragments, None
    disparity = fragments.disparity[asked]
    surface = surface_samples(triangles, fragments.sample[asked], fragments.triangle[asked], grid)
    extent_m = 1.0 / (disparity * float(camera.focal_px) * grid.supersampling)
    share = _shares(scene.opacity(), surface.face, surface.barycentric, extent_m)
    opacity = np.ones(len(fragments.sample), dtype=np.float32)
    opacity[asked] = np.round(share * LEVELS) / LEVELS
    there = np.flatnonzero(opacity)
    opacity = opacity[there]
    fragments = fragments.take(there)
    if (opacity == 1.0).all():
        return fragments, None
    nearer = np.where(opacity < 1.0, NEARER, 1.0).astype(fragments.disparity.dtype)
    return dataclasses.replace(fragments, disparity=fragments.disparity * nearer), opacity


def _shares(opacity: Opacity, face: np.ndarray, barycentric: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """Opacity [n] of surface samples."""
    real = jnp.zeros(()).dtype

    def program(*samples: Array) -> Array:
        return _block(opacity, *samples)

    return in_blocks(program, (face, barycentric.astype(real), extent.astype(real)), _AT_ONCE)


@jit
def _block(
    opacity: Opacity, face: Int[Array, " n"], barycentric: Float[Array, "n 3"], extent: Float[Array, " n"]
) -> Float[Array, " n"]:
    # Blocks that fit the cache, as for shading.
    return jax.lax.map(lambda sample: opacity(*sample), (face, barycentric, extent), batch_size=4096)
