"""Smooth profiles over the radius of the pupil, through values at evenly spaced radii."""

from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import real_numbers

# Exact for r^3 times a cubic.
_NODES, _WEIGHTS = ((a + b) / 2 for a, b in zip(np.polynomial.legendre.leggauss(4), (1.0, 0.0), strict=True))


class RadialSpline(eqx.Module):
    """A function of the pupil's radius r, 0 to 1, by cubic pieces with a continuous slope.

    The slope at a value is that of the parabola through it and its neighbours, and 0 in the middle, so that
    any v0 + c r^2 is met exactly, by two values or more. Beyond r = 1 the function is as at 1.

    Attributes:
        values: at the radii 0, 1 / (k - 1), ..., 1.

    Example:
        >>> parabola = radial_spline([0.0, 4.0])
        >>> float(parabola(jnp.array(0.5)))
        1.0
    """

    values: Float[Array, "k"]

    def __call__(self, radius: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The value at `radius`."""
        pieces = self.pieces()
        scaled = jnp.clip(radius, 0.0, 1.0) * len(pieces)
        number = jnp.minimum(jnp.floor(scaled).astype(int), len(pieces) - 1)
        t = scaled - number.astype(scaled.dtype)
        b0, b1, b2, b3 = jnp.moveaxis(pieces[number], -1, 0)
        u = 1.0 - t
        return u**3 * b0 + 3.0 * u**2 * t * b1 + 3.0 * u * t**2 * b2 + t**3 * b3

    def pieces(self) -> Float[Array, "pieces 4"]:
        """Bernstein coefficients of each piece, which bound it."""
        values = self.values
        if len(values) == 2:
            last = 2.0 * (values[1] - values[0])
        else:
            last = 0.5 * (3.0 * values[-1] - 4.0 * values[-2] + values[-3])
        inner = 0.5 * (values[2:] - values[:-2])
        slopes = jnp.concatenate([jnp.zeros_like(values[:1]), inner, last[None]])
        start, end = values[:-1], values[1:]
        return jnp.stack([start, start + slopes[:-1] / 3.0, end - slopes[1:] / 3.0, end], axis=-1)

    def extent(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Numbers that no value is below and above; of two values, the least and the largest."""
        pieces = self.pieces()
        return jnp.min(pieces), jnp.max(pieces)

    def defocus(self) -> Float[Array, ""]:
        """Mean over the pupil, weighted by r^2: the constant that fits r times the function best."""
        count = len(self.values) - 1
        radii = ((np.arange(count)[:, None] + _NODES) / count).reshape(-1)
        shares = 4.0 * radii**3 * np.tile(_WEIGHTS, count) / count
        dtype = self.values.dtype
        return jnp.asarray(shares, dtype=dtype) @ self(jnp.asarray(radii, dtype=dtype))


def radial_spline(values: ArrayLike | Sequence[SupportsFloat]) -> RadialSpline:
    """A `RadialSpline` with checked values.

    Raises:
        ValueError: fewer than two values, or one that is not finite.
    """
    numbers = real_numbers(values, "values of a spline", "finite numbers, from the middle to the rim")
    if numbers.ndim != 1 or len(numbers) < 2:
        raise ValueError(
            f"a profile has values of shape {numbers.shape}; give two or more, from the middle to the rim"
        )
    if not np.isfinite(numbers).all():
        raise ValueError(f"a profile has values {numbers.tolist()}; expected finite numbers")
    return RadialSpline(jnp.asarray(numbers, dtype=float))
