"""A surface given by heights on a grid, as the general lens of Lee10 section 3 has them."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax.optics._surfaces import AbstractSurface, Real, newton


class HeightField(AbstractSurface):
    """Heights on a square grid about the vertex, joined by bicubic patches (Catmull and Rom).

    The surface and its normal are continuous. Of a smooth surface, heights between the samples are met to the
    third power of the spacing, and normals to the second. Beyond the grid's last ring but one there is no
    surface.

    Attributes:
        heights: sag in mm [n, n]; the first axis is y, the second x, both increasing.
        spacing: mm between neighbours.

    Example:
        >>> across = jnp.linspace(-6, 6, 25)
        >>> bowl = HeightField(0.01 * (across[:, None]**2 + across[None]**2), jnp.asarray(0.5))
        >>> round(float(bowl.sag(jnp.asarray(1.1), jnp.asarray(0.0))), 4)
        0.0121
    """

    heights: Float[Array, "n n"]
    spacing: Float[Array, ""]

    def __check_init__(self):
        if self.heights.shape[0] < 4:
            raise ValueError(f"a height field has {self.heights.shape[0]} rows; expected at least 4")

    def sag(self, x: Real, y: Real) -> Real:
        return self._at(x, y)[0]

    def meet(self, x: Real, y: Real, u: Real, v: Real, w: Real) -> tuple[Real, Bool[Array, ""]]:
        distance, met = newton(self, jnp.zeros_like(x), x, y, u, v, w)
        reach = 0.5 * self.spacing * (self.heights.shape[0] - 3)
        inside = (jnp.abs(x + distance * u) <= reach) & (jnp.abs(y + distance * v) <= reach)
        return distance, met & inside

    def normal(self, x: Real, y: Real, z: Real) -> tuple[Real, Real, Real]:
        del z
        _, by_x, by_y = self._at(x, y)
        return -by_x, -by_y, jnp.ones_like(x)

    def osculating(self) -> tuple[Real, Real]:
        # Along the grid's axes, by differences over two cells.
        step, zero = 2.0 * self.spacing, jnp.zeros_like(self.spacing)
        rise = sum(
            (self.sag(a, b) for a, b in ((step, zero), (-step, zero), (zero, step), (zero, -step))), zero
        )
        return (rise - 4.0 * self.sag(zero, zero)) / (2.0 * step**2), zero

    def scaled(self, factor: Real) -> "HeightField":
        return HeightField(self.heights * factor, self.spacing * factor)

    def _at(self, x: Real, y: Real) -> tuple[Real, Real, Real]:
        """Height and its slopes; the outermost whole cell goes on beyond the grid."""
        count = self.heights.shape[0]
        place = [coordinate / self.spacing + (count - 1) / 2 for coordinate in (y, x)]
        cell = [jnp.clip(jnp.floor(p), 1, count - 3).astype(int) for p in place]
        # No farther than a cell: a cubic runs away.
        share = [jnp.clip(p - c, -1.0, 2.0) for p, c in zip(place, cell, strict=True)]
        (rows, row_slopes), (columns, column_slopes) = (_weights(s) for s in share)
        near = jnp.stack(
            [self.heights[cell[0] + i - 1, cell[1] + j - 1] for i in range(4) for j in range(4)]
        ).reshape(4, 4)
        height = rows @ near @ columns
        return height, rows @ near @ column_slopes / self.spacing, row_slopes @ near @ columns / self.spacing


def _weights(t: Real) -> tuple[Float[Array, "4"], Float[Array, "4"]]:
    """Of four neighbours at a place `t` between the middle two, and their derivatives by t."""
    weights = [t * (t * (2.0 - t) - 1.0), t * t * (3.0 * t - 5.0) + 2.0, t * (t * (4.0 - 3.0 * t) + 1.0)]
    slopes = [t * (4.0 - 3.0 * t) - 1.0, t * (9.0 * t - 10.0), t * (8.0 - 9.0 * t) + 1.0]
    last, last_slope = t * t * (t - 1.0), t * (3.0 * t - 2.0)
    return 0.5 * jnp.stack([*weights, last]), 0.5 * jnp.stack([*slopes, last_slope])
