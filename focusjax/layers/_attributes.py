"""What the surface is at a fragment: its face, barycentric weights, and the slope of its plane."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.layers._blocks import in_blocks, pad_rows, padded_length
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid
from focusjax.layers._stamps import Stamps

_AT_ONCE = 1 << 18


@dataclasses.dataclass(frozen=True)
class SurfaceSamples:
    """Attributes of n samples of surface.

    Attributes:
        face: the scene's face [n].
        barycentric: weights [n, 3] of that face's corners, perspective-correct.
        slope: change of disparity [n, 2] per sample in x and y along the surface's plane.
    """

    face: np.ndarray
    barycentric: np.ndarray
    slope: np.ndarray


@jax.jit
def _attributes(
    edges: Float[Array, "m 3 3"],
    disparity: Float[Array, "m 3"],
    stamp: Int[Array, " n"],
    x: Float[Array, " n"],
    y: Float[Array, " n"],
) -> tuple[Float[Array, "n 3"], Float[Array, "n 2"]]:
    """Weights in the clipped triangle, and slopes.

    The share of corner i on screen is e_i / h_i; seen in perspective its weight is that times
    w_i / w, which is e_i (w_i / h_i) over the sum of the same.
    """
    e, scale = edges[stamp], disparity[stamp]
    distance = e[:, :, 0] * x[:, None] + e[:, :, 1] * y[:, None] + e[:, :, 2]
    share = jnp.maximum(distance, 0.0) * scale
    total = jnp.maximum(share.sum(axis=1, keepdims=True), jnp.finfo(share.dtype).tiny)
    slope = (e[:, :, :2] * scale[:, :, None]).sum(axis=1)
    return share / total, slope


def surface_samples(
    stamps: Stamps, triangles: ScreenTriangles, sample: np.ndarray, stamp: np.ndarray, grid: Grid
) -> SurfaceSamples:
    """Attributes of the fragments at grid index `sample` [n] that came from `stamp` [n]."""
    row, column = np.divmod(sample, np.int32(grid.columns))
    x = (column - stamps.origin[stamp, 0]).astype(np.float32)
    y = (row - stamps.origin[stamp, 1]).astype(np.float32)
    length = padded_length(len(stamps.triangle))
    edges, disparity = (jnp.asarray(pad_rows(a, length)) for a in (stamps.edges, stamps.disparity))

    def program(stamp: Array, x: Array, y: Array) -> tuple[Array, Array]:
        return _attributes(edges, disparity, stamp, x, y)

    barycentric, slopes = in_blocks(program, (stamp, x, y), _AT_ONCE)
    triangle = stamps.triangle[stamp]
    clipped = np.flatnonzero(triangle >= triangles.unclipped)
    if len(clipped):
        mixed = barycentric[clipped, :, None] * triangles.weights[triangle[clipped] - triangles.unclipped]
        barycentric[clipped] = mixed.sum(axis=1)
    return SurfaceSamples(triangles.source[triangle], barycentric, slopes)
