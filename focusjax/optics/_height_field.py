"""A surface given by heights on a grid, as the general lens of Lee10 section 3 has them."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.optics._surfaces import MET, AbstractSurface, Conic, Real

_MOST_STEPS = 8
_NEAR = 1e-5
"""Millimetres from the surface at which the search ends; two more steps take the rest."""
_SHARE, _LEAST_CELLS, _MOST_SAMPLES = 0.5, 2.2, 48
"""The osculating sphere is fitted in a share of the radius that heights reach to, within a least radius in
cells, to so many samples along its diameter."""

_Patch = tuple[list[list[Real]], Int[Array, ""], Int[Array, ""]]
"""Sixteen heights by rows, and the row and column of the cell; numbers, which compilers keep in registers."""


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

    def reach(self) -> Real:
        """Millimetres from the vertex, along x and y, to where the surface ends."""
        return 0.5 * self.spacing * (self.heights.shape[0] - 3)

    def sag(self, x: Real, y: Real) -> Real:
        return self._on(self._patch(x, y), x, y)[0]

    def meet(self, x: Real, y: Real, u: Real, v: Real, w: Real) -> tuple[Real, Bool[Array, ""]]:
        """By Newton's method, whose answer is differentiable as the root that it is; see `newton`.

        The search begins at the osculating sphere and ends as soon as it is near. Both steps after it are on
        the patch where it ended, whose heights are looked up once.
        """
        found = jax.lax.stop_gradient(self)._search(*jax.lax.stop_gradient((x, y, u, v, w)))
        patch = self._patch(x + found * u, y + found * v)
        distance, off = found, found
        for _ in range(2):
            distance, off = self._step(patch, distance, x, y, u, v, w)
        met = jnp.abs(off) < MET
        inside = jnp.maximum(jnp.abs(x + distance * u), jnp.abs(y + distance * v)) <= self.reach()
        return jnp.where(met, distance, 0.0), met & inside

    def normal(self, x: Real, y: Real, z: Real) -> tuple[Real, Real, Real]:
        del z
        _, by_x, by_y = self._on(self._patch(x, y), x, y)
        return -by_x, -by_y, jnp.ones_like(x)

    def osculating(self) -> tuple[Real, Real]:
        """Of the even polynomial in r of least squares over the inner half, so that noise counts little."""
        places, second, fourth, radius = _even_fit(self.heights.shape[0])
        heights, radius = self.heights[places], radius * self.spacing
        c = 2.0 * (jnp.asarray(second, heights.dtype) @ heights) / radius**2
        return c, jnp.asarray(fourth, heights.dtype) @ heights / radius**4 - c**3 / 8.0

    def scaled(self, factor: Real) -> "HeightField":
        return HeightField(self.heights * factor, self.spacing * factor)

    def _search(self, x: Real, y: Real, u: Real, v: Real, w: Real) -> Real:
        """Distance along a ray to near the surface, or to where the search gave up."""
        start, _ = Conic(self.osculating()[0], jnp.zeros_like(x)).meet(x, y, u, v, w)

        def going_on(state: tuple[Array, Real, Real]) -> Array:
            number, _, off = state
            return (number < _MOST_STEPS) & (jnp.abs(off) > _NEAR)

        def step(state: tuple[Array, Real, Real]) -> tuple[Array, Real, Real]:
            number, distance, _ = state
            patch = self._patch(x + distance * u, y + distance * v)
            return number + 1, *self._step(patch, distance, x, y, u, v, w)

        return jax.lax.while_loop(going_on, step, (jnp.asarray(0), start, jnp.full_like(start, jnp.inf)))[1]

    def _step(
        self, patch: _Patch, distance: Real, x: Real, y: Real, u: Real, v: Real, w: Real
    ) -> tuple[Real, Real]:
        """The distance after a step of Newton's method on a patch, and how far in mm it was off before."""
        sag, by_x, by_y = self._on(patch, x + distance * u, y + distance * v)
        rate = w - by_x * u - by_y * v
        steep, off = jnp.abs(rate) > 1e-3, distance * w - sag
        return distance - jnp.where(steep, off / jnp.where(steep, rate, 1.0), 0.0), off

    def _patch(self, x: Real, y: Real) -> _Patch:
        """The sixteen heights around a place, and its cell; the outermost whole cell goes on."""
        count = self.heights.shape[0]
        row, column = (
            jnp.clip(jnp.floor(coordinate / self.spacing + (count - 1) / 2), 1, count - 3).astype(int)
            for coordinate in (y, x)
        )
        # One look-up of all, which compiles sooner than sixteen.
        beside = jnp.arange(16)
        found = self.heights[row - 1 + beside // 4, column - 1 + beside % 4]
        return [[found[4 * i + j] for j in range(4)] for i in range(4)], row, column

    def _on(self, patch: _Patch, x: Real, y: Real) -> tuple[Real, Real, Real]:
        """Height of a patch at a place, and its slopes along x and y."""
        near, *cell = patch
        middle = (self.heights.shape[0] - 1) / 2
        # No farther than a cell: a cubic runs away.
        share = [
            jnp.clip(at / self.spacing + middle - c, -1.0, 2.0) for at, c in zip((y, x), cell, strict=True)
        ]
        (rows, row_slopes), (columns, column_slopes) = (_weights(s) for s in share)
        along = [_sum(columns, each) for each in near]
        by_x = _sum(rows, [_sum(column_slopes, each) for each in near]) / self.spacing
        return _sum(rows, along), by_x, _sum(row_slopes, along) / self.spacing


def _even_fit(count: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray, float]:
    """Grid points in a disk, what each adds to the terms of s^2 and s^4, and the disk's radius in cells.

    Of the polynomial 1, x, y, s^2, s^4, s^6 of least squares, with s the share of that radius.
    """
    middle = (count - 1) / 2
    radius = max(_SHARE * (count - 3) / 2, min(_LEAST_CELLS, middle * math.sqrt(2.0)))
    reach = min(int(radius), int(middle))
    stride = max(1, 2 * reach // _MOST_SAMPLES)
    low, high = math.floor(middle), math.ceil(middle)
    along = np.unique(np.concatenate([np.arange(low, -1, -stride), np.arange(high, count, stride)]))
    rows, columns = (each.ravel() for each in np.meshgrid(along, along, indexing="ij"))
    y, x = (rows - middle) / radius, (columns - middle) / radius
    within = x * x + y * y <= 1.0 + 1e-9
    rows, columns, x, y = (each[within] for each in (rows, columns, x, y))
    square = x * x + y * y
    most = min(3, len(np.unique(square.round(9))) - 1)
    terms = np.stack([np.ones_like(x), x, y, *(square**power for power in range(1, most + 1))], axis=1)
    weights = np.linalg.pinv(terms)
    fourth = weights[4] if most > 1 else np.zeros_like(x)
    return (rows, columns), weights[3], fourth, radius


def _weights(t: Real) -> tuple[list[Real], list[Real]]:
    """Of four neighbours at a place `t` between the middle two, and their derivatives by t."""
    weights = [
        t * (t * (2.0 - t) - 1.0),
        t * t * (3.0 * t - 5.0) + 2.0,
        t * (t * (4.0 - 3.0 * t) + 1.0),
        t * t * (t - 1.0),
    ]
    slopes = [t * (4.0 - 3.0 * t) - 1.0, t * (9.0 * t - 10.0), t * (8.0 - 9.0 * t) + 1.0, t * (3.0 * t - 2.0)]
    return [0.5 * each for each in weights], [0.5 * each for each in slopes]


def _sum(weights: list[Real], values: list[Real]) -> Real:
    """The four values, weighted."""
    (a, b, c, d), (p, q, r, s) = weights, values
    return a * p + b * q + c * r + d * s
