"""What the surface is at a fragment: its face, barycentric weights, and the slope of its plane."""

import dataclasses
import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax._parallel import in_parallel, parts
from focusjax._programs import jit
from focusjax.layers._blocks import pad_rows
from focusjax.layers._clip import ScreenTriangles, edge_functions
from focusjax.layers._grid import Grid

_AT_ONCE = 1 << 16


@dataclasses.dataclass(frozen=True)
class SurfaceSamples:
    """Attributes of n samples of surface.

    Attributes:
        face: the scene's face [n].
        barycentric: weights [n, 3] of that face's corners, perspective-correct.
        slope_x: change of disparity [n] per sample to the right, along the surface's plane.
        slope_y: the same downwards.
        inside: whether [n] the square of a sample's size around it lies inside the triangle.
    """

    face: np.ndarray
    barycentric: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray
    inside: np.ndarray


@jit
def _attributes(
    x: tuple[Float[Array, " n"], ...], y: tuple[Float[Array, " n"], ...], w: tuple[Float[Array, " n"], ...]
) -> tuple[Float[Array, "n 3"], Float[Array, " n"], Float[Array, " n"], Bool[Array, " n"]]:
    """As `SurfaceSamples` has it from `barycentric` on, at the place from which corners are counted.

    Weights are those in the clipped triangle.

    The share of corner i on screen is e_i / h_i; seen in perspective its weight is that times
    w_i / w, which is e_i (w_i / h_i) over the sum of the same.
    """
    edges = edge_functions(x, y, w, jnp)
    share = [jnp.maximum(offset, 0.0) * scale for _, _, offset, scale in edges]
    slope_x, slope_y = (sum((edge[k] * edge[3] for edge in edges), jnp.zeros((), x[0].dtype)) for k in (0, 1))
    total = jnp.maximum(sum(share), jnp.finfo(x[0].dtype).tiny)
    reach = [offset - 0.5 * (jnp.abs(across) + jnp.abs(down)) for across, down, offset, _ in edges]
    inside = functools.reduce(jnp.minimum, reach) >= 0
    return jnp.stack([part / total for part in share], axis=1), slope_x, slope_y, inside


def surface_samples(
    triangles: ScreenTriangles,
    sample: np.ndarray,
    triangle: np.ndarray,
    grid: Grid,
    offset: np.ndarray | None = None,
) -> SurfaceSamples:
    """Attributes of the fragments at grid index `sample` [n] that are of the screen's `triangle` [n].

    At the samples' centres, or at the `offset` [n, 2] from them in samples.
    """

    def block(part: slice) -> tuple[np.ndarray, ...]:
        number, where = triangle[part], sample[part]
        row = where // np.int32(grid.columns)
        place = where - row * np.int32(grid.columns), row
        if offset is not None:
            place = place[0] + offset[part, 0].astype(float), row + offset[part, 1].astype(float)
        corners = triangles.around(number, *place)
        inputs: Any = (tuple(pad_rows(a.astype(np.float32), _AT_ONCE) for a in some) for some in corners)
        found = [np.asarray(a)[: len(number)] for a in _attributes(*inputs)]
        clipped = np.flatnonzero(number >= triangles.unclipped)
        if len(clipped):
            found[0] = found[0].copy()
            mixed = found[0][clipped, :, None] * triangles.weights[number[clipped] - triangles.unclipped]
            found[0][clipped] = mixed.sum(axis=1)
        return np.take(triangles.source, number), *found

    blocks = in_parallel(block, parts(len(sample), _AT_ONCE)) or [block(slice(0, 0))]
    return SurfaceSamples(*(np.concatenate(column) for column in zip(*blocks, strict=True)))
