"""What the surface is at a fragment: its face, barycentric weights, and the slope of its plane."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._parallel import in_parallel, parts
from focusjax.layers._blocks import pad_rows, padded_length
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid
from focusjax.layers._stamps import Stamps

_AT_ONCE = 1 << 16


@dataclasses.dataclass(frozen=True)
class SurfaceSamples:
    """Attributes of n samples of surface.

    Attributes:
        face: the scene's face [n].
        barycentric: weights [n, 3] of that face's corners, perspective-correct.
        slope_x: change of disparity [n] per sample to the right, along the surface's plane.
        slope_y: the same downwards.
    """

    face: np.ndarray
    barycentric: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray


@jax.jit
def _attributes(
    coefficients: tuple[Float[Array, " m"], ...],
    stamp: Int[Array, " n"],
    x: Float[Array, " n"],
    y: Float[Array, " n"],
) -> tuple[Float[Array, "n 3"], Float[Array, " n"], Float[Array, " n"]]:
    """Weights in the clipped triangle, and slopes in x and y, from columns of twelve numbers per stamp.

    The share of corner i on screen is e_i / h_i; seen in perspective its weight is that times
    w_i / w, which is e_i (w_i / h_i) over the sum of the same.
    """
    # Number by number: rows are looked up ten times slower.
    at = [column.at[stamp].get(mode="promise_in_bounds") for column in coefficients]
    share, slope_x, slope_y = [], jnp.zeros_like(x), jnp.zeros_like(x)
    for corner in range(3):
        across, down, offset, scale = at[4 * corner : 4 * corner + 4]
        share.append(jnp.maximum(across * x + down * y + offset, 0.0) * scale)
        slope_x, slope_y = slope_x + across * scale, slope_y + down * scale
    total = jnp.maximum(sum(share), jnp.finfo(x.dtype).tiny)
    return jnp.stack([part / total for part in share], axis=1), slope_x, slope_y


def surface_samples(
    stamps: Stamps,
    triangles: ScreenTriangles,
    sample: np.ndarray,
    stamp: np.ndarray,
    grid: Grid,
    offset: np.ndarray | None = None,
) -> SurfaceSamples:
    """Attributes of the fragments at grid index `sample` [n] that came from `stamp` [n].

    At the samples' centres, or at the `offset` [n, 2] from them in samples.
    """
    length = padded_length(len(stamps.triangle))
    rows = np.concatenate([stamps.edges, stamps.disparity[:, :, None]], axis=2).reshape(-1, 12)
    coefficients = tuple(jnp.asarray(pad_rows(column, length)) for column in rows.T)
    left, top = stamps.origin.T.copy()

    def block(part: slice) -> tuple[np.ndarray, ...]:
        row, column = np.divmod(sample[part], np.int32(grid.columns))
        x = (column - np.take(left, stamp[part])).astype(np.float32)
        y = (row - np.take(top, stamp[part])).astype(np.float32)
        if offset is not None:
            x, y = x + offset[part, 0], y + offset[part, 1]
        inputs = (pad_rows(a, _AT_ONCE) for a in (stamp[part], x, y))
        found = [np.asarray(a)[: len(x)] for a in _attributes(coefficients, *inputs)]
        triangle = np.take(stamps.triangle, stamp[part])
        clipped = np.flatnonzero(triangle >= triangles.unclipped)
        if len(clipped):
            found[0] = found[0].copy()
            mixed = found[0][clipped, :, None] * triangles.weights[triangle[clipped] - triangles.unclipped]
            found[0][clipped] = mixed.sum(axis=1)
        return np.take(triangles.source, triangle), *found

    blocks = in_parallel(block, parts(len(sample), _AT_ONCE)) or [block(slice(0, 0))]
    return SurfaceSamples(*(np.concatenate(column) for column in zip(*blocks, strict=True)))
