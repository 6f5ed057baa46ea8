"""What changes smoothly over the frame, found at few places and known for all pixels."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._at_once import one_by_one
from focusjax.geometry import Camera

_NODES = 17, 25
"""Along the longer side of the frame at least and at most."""
_FEWEST_NODES = 7
_PIXELS_APART = 8


class FrameNodes(eqx.Module):
    """Places on a grid over the frame, its corners among them.

    Attributes:
        rows: of the grid (static), an odd number, so that every other one is at each end, too.
        columns: as many, across (static).
        width: of the frame in pixels (static).
        height: the same (static).
    """

    rows: int = eqx.field(static=True)
    columns: int = eqx.field(static=True)
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)

    def places(self) -> Float[np.ndarray, "n 2"]:
        """Film points of the nodes, row-major, in pixels."""
        y, x = np.meshgrid(
            np.linspace(0.0, self.height, self.rows),
            np.linspace(0.0, self.width, self.columns),
            indexing="ij",
        )
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def at_all(self, function: Callable[[Float[Array, "2"]], Float[Array, "*c"]]) -> Float[Array, "n *c"]:
        """What a function of a film point is at all nodes."""
        return one_by_one(function, jnp.asarray(self.places(), dtype=jnp.zeros(()).dtype))

    def in_pixels(self, values: Float[Array, "n c"], degree: int) -> Float[Array, "p c"]:
        """Values at all pixel centres, row-major, by a spline through those of the nodes."""
        centres = tuple((np.arange(size) + 0.5) / size for size in (self.height, self.width))
        return self._spread(values, degree, centres)

    def off(self, values: Float[Array, "n c"], degree: int) -> Float[Array, "n c"]:
        """By how much a spline of every other node misses those between, around each; more than all miss."""
        grid = values.reshape(self.rows, self.columns, -1)
        whole = np.linspace(0.0, 1.0, self.rows), np.linspace(0.0, 1.0, self.columns)
        few = FrameNodes(self.rows // 2 + 1, self.columns // 2 + 1, self.width, self.height)
        coarse = few._spread(grid[::2, ::2].reshape(few.rows * few.columns, -1), degree, whole)
        missed = jnp.abs(coarse.reshape(grid.shape) - grid)
        worst = jax.lax.reduce_window(missed, 0.0, jax.lax.max, (3, 3, 1), (1, 1, 1), "same")
        return worst.reshape(values.shape)

    def _spread(
        self, values: Float[Array, "n c"], degree: int, to: Sequence[Float[np.ndarray, " _"]]
    ) -> Float[Array, "p c"]:
        """Values at places (y, x), shares of the sides."""
        down, across = (
            jnp.asarray(_spline(count, at, degree), dtype=values.dtype)
            for count, at in zip((self.rows, self.columns), to, strict=True)
        )
        grid = values.reshape(self.rows, self.columns, -1)
        found = jnp.einsum("yr,rcb,xc->yxb", down, grid, across, precision="highest")
        return found.reshape(-1, grid.shape[-1])


def frame_nodes(camera: Camera) -> FrameNodes:
    """Nodes some pixels apart, 17 to 25 of them along the longer side."""
    longest = max(camera.width, camera.height)
    along = min(max(longest // _PIXELS_APART + 1, _NODES[0]), _NODES[1])
    rows, columns = (
        max(_FEWEST_NODES, round(along * side / longest)) | 1 for side in (camera.height, camera.width)
    )
    return FrameNodes(rows, columns, camera.width, camera.height)


def _spline(count: int, at: Float[np.ndarray, " p"], degree: int) -> Float[np.ndarray, "p n"]:
    """Shares of `count` nodes from 0 to 1 in a spline `at` some places."""
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(np.linspace(0.0, 1.0, count), np.eye(count), k=degree)(at)
