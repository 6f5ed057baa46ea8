"""Control points of a focal surface, the surface through them, and its samples at the corners of pixels."""

from collections.abc import Sequence
from typing import TypeAlias, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int

from focusjax._arguments import real_numbers
from focusjax._parallel import CORES, in_parallel
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._density import cell
from focusjax.lens._kernels import AbstractKernel, InverseDistance
from focusjax.lens._moving_least_squares import Basis, moving_least_squares

Numbers: TypeAlias = ArrayLike | Sequence
_TILE = (16, 32)
"""Rows and columns of places that are worked out together: what they need fits into a core's cache."""


class FocalSurface(eqx.Module):
    """Focal disparity and aperture scale all over the picture, from control points (Lee10 section 5.2).

    Attributes:
        xy: places of the control points in pixels, inside the picture or not.
        focus_disparity: 1 / focus distance at each of them, in 1/m.
        aperture_scale: aperture radius at each of them, in radii of the whole lens; blur is in proportion
            to it. Below 1 more depth is sharp around the point, above 1 less; never negative.
        weight: how widely each point rules its neighbourhood (alpha of Lee10); 0 for not at all.
        kernel: how influence falls off with distance.
        basis: "constant", "affine" or "quadratic" (static): how the surface goes on beyond the points and
            between them. The aperture scale is of constant basis always, which keeps it between
            the values given.

    Example:
        >>> surface = focal_surface([(10.0, 20.0), (50.0, 20.0)], [0.5, 1.0])
        >>> [round(float(v), 6) for v in surface.at(jnp.array([50.0, 20.0]))]
        [1.0, 1.0]
    """

    xy: Float[Array, "k 2"]
    focus_disparity: Float[Array, "k"]
    aperture_scale: Float[Array, "k"]
    weight: Float[Array, "k"]
    kernel: AbstractKernel
    basis: Basis = eqx.field(static=True)

    def at(self, place: Float[Array, "2 *p"]) -> tuple[Float[Array, "*p"], Float[Array, "*p"]]:
        """Focal disparity in 1/m and aperture scale at pixel positions (x, y)."""
        focus, scale = self._interpolated(place, self.focus_disparity[:, None], self.aperture_scale[:, None])
        return focus, scale

    def shares(self, place: Float[Array, "2 *p"]) -> Float[Array, "k *p"]:
        """How much the focal disparity at pixel positions changes per change at each control point."""
        each = jnp.eye(self.xy.shape[0], dtype=self.xy.dtype)
        return self._interpolated(place, each)

    def _interpolated(
        self,
        place: Float[Array, "2 *p"],
        values: Float[Array, "k m"],
        levels: Float[Array, "k l"] | None = None,
    ) -> Float[Array, "surfaces *p"]:
        return moving_least_squares(place, self.xy, values, self.weight, self.kernel, self.basis, levels)


def focal_surface(
    xy: Numbers,
    focus_disparity: Numbers,
    *,
    aperture_scale: Numbers = 1.0,
    weight: Numbers = 1.0,
    kernel: AbstractKernel | None = None,
    basis: Basis = "constant",
) -> FocalSurface:
    """A `FocalSurface` with checked values; single numbers hold for all control points.

    Args:
        xy: k places (x, y) in pixels.
        focus_disparity: 1/m.
        aperture_scale: 0 or more.
        weight: 0 or more, above 0 somewhere. Where points overlap and contradict each other, Lee10 section
            5.2 lets near points count more and hidden ones fade out: `ImagePoints.weight` of points that
            were found by `locate` is such a weight, with `favour_near=1` for the near ones.
        kernel: `InverseDistance` with exponent 2 when not given.
        basis: degree of the polynomial.

    Raises:
        ValueError: no points, lengths that differ, or a value out of range.

    Example:
        >>> surface = fj.focal_surface([(10, 20), (50, 20)], [0.5, 1.0])
        >>> focus_disparity, aperture_scale = surface.at(jnp.array([30.0, 20.0]))
        >>> round(float(focus_disparity), 6), float(aperture_scale)
        (0.75, 1.0)
    """
    places = real_numbers(xy, "the places of control points", "k rows of (x, y) in pixels, at least one")
    if places.ndim != 2 or places.shape[1] != 2 or not len(places):
        raise ValueError(f"control points have shape {places.shape}; expected k rows of (x, y), at least one")
    if basis not in get_args(Basis):
        raise ValueError(f"basis is {basis!r}; expected one of {list(get_args(Basis))}")
    count = len(places)
    columns = {}
    for name, value in (
        ("focus disparity", focus_disparity),
        ("aperture scale", aperture_scale),
        ("weight", weight),
    ):
        column = real_numbers(value, f"control points' {name}", f"one number, or {count}")
        if column.shape not in ((), (count,)):
            raise ValueError(f"{name} has shape {column.shape}; expected one number, or {count}")
        if not np.isfinite(column).all() or (name != "focus disparity" and (column < 0).any()):
            low = "a finite number" if name == "focus disparity" else "a finite number of at least 0"
            raise ValueError(f"a control point's {name} is {_worst(column):g}; expected {low}")
        columns[name] = jnp.asarray(np.broadcast_to(column, (count,)), dtype=float)
    if not np.isfinite(places).all():
        raise ValueError(f"a control point's position is {_worst(places):g}; expected finite pixels")
    if not (np.asarray(columns["weight"]) > 0).any():
        raise ValueError("every control point has weight 0; give at least one a positive weight")
    return FocalSurface(
        xy=jnp.asarray(places, dtype=float),
        focus_disparity=columns["focus disparity"],
        aperture_scale=columns["aperture scale"],
        weight=columns["weight"],
        kernel=InverseDistance(jnp.asarray(2.0, dtype=float)) if kernel is None else kernel,
        basis=basis,
    )


def _worst(values: np.ndarray) -> float:
    """The first value that is not finite, or the least."""
    wrong = values[~np.isfinite(values)]
    return float(wrong[0] if wrong.size else values.min())


def corner_weights(
    camera: Camera, film_point: Float[Array, "2"], shape: tuple[int, ...]
) -> list[tuple[tuple[Int[Array, ""], Int[Array, ""]], Float[Array, ""]]]:
    """Row, column and share of the four corners around a film point; beyond the frame as on its border.

    Raises:
        ValueError: a surface whose `shape` is not that of the camera's pixel corners.
    """
    rows, columns = shape
    if (columns, rows) != (camera.width + 1, camera.height + 1):
        raise ValueError(
            f"the focal surface was sampled for {columns - 1} x {rows - 1} pixels but the camera has"
            f" {camera.width} x {camera.height}; sample it for this camera"
        )
    (i, u), (j, v) = cell(film_point[0], camera.width), cell(film_point[1], camera.height)
    return [
        ((j + step_j, i + step_i), share_j * share_i)
        for step_j, share_j in ((0, 1.0 - v), (1, v))
        for step_i, share_i in ((0, 1.0 - u), (1, u))
    ]


def at_corners(
    surface: FocalSurface, camera: Camera
) -> tuple[Float[Array, "rows columns"], Float[Array, "rows columns"]]:
    """Focal disparity and aperture scale of a surface at all pixel corners of `camera`."""
    width, height = camera.width + 1, camera.height + 1
    tall, wide = _TILE
    down, across = -(-height // tall), -(-width // wide)
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(surface))
    # XLA works out tile after tile on one core of a CPU.
    shares = 1 if traced or jax.default_backend() != "cpu" else CORES
    some = np.array_split(np.arange(shares * -(-down * across // shares)), shares)
    found = in_parallel(lambda numbers: _tiles(surface, jnp.asarray(numbers), across), some)

    def joined(tiles: list[Float[Array, "tiles p"]]) -> Float[Array, "rows columns"]:
        rows = jnp.concatenate(tiles)[: down * across].reshape(down, across, tall, wide).swapaxes(1, 2)
        return rows.reshape(down * tall, across * wide)[:height, :width]

    focus, scale = zip(*found, strict=True)
    return joined(list(focus)), joined(list(scale))


@jit
def _tiles(
    surface: FocalSurface, numbers: Int[Array, " n"], across: int
) -> tuple[Float[Array, "n p"], Float[Array, "n p"]]:
    """Both at the places of some tiles, counted row by row, `across` to a row."""
    tall, wide = _TILE

    def tile(number: Int[Array, ""]) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        rows = number // across * tall + jnp.repeat(jnp.arange(tall), wide)
        columns = number % across * wide + jnp.tile(jnp.arange(wide), tall)
        return surface.at(jnp.stack([columns, rows]).astype(surface.xy.dtype))

    return jax.lax.map(tile, numbers)
