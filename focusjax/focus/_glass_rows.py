"""Errors of wishes in the blur of glass, with their slopes, from what rays say of it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._glass_blur import GlassBlur, Sensed
from focusjax.focus._image_points import (
    ACROSS,
    AT_LEAST,
    AT_MOST,
    BLUR,
    EQUAL,
    SAME,
    ImagePoints,
    root_weight,
)
from focusjax.focus._priors import PriorRows

_NEAR_PX = 1e-3
"""A limit that is kept with more room than this does not hold the solution."""


class Linear(eqx.Module):
    """Half the sum of squared errors about some free parameters.

    Attributes:
        gradient: [k].
        normal: the products of slopes, which Gauss and Newton take for the curvature [k, k].
        curvature: by differences of gradients [k, k].
    """

    gradient: Float[Array, "k"]
    normal: Float[Array, "k k"]
    curvature: Float[Array, "k k"]


class GlassRows(eqx.Module):
    """What rows wish, with the sides of the focus that are settled.

    Attributes:
        points: the wishes.
        sign: of every row's defocus, which its blur keeps.
        other_sign: the same of references, if there are any.
        on: rows that hold the solution.
    """

    points: ImagePoints
    sign: Float[Array, "n"]
    other_sign: Float[Array, "n"] | None
    on: Bool[Array, "n"]

    def linear(
        self,
        found: Sensed,
        values: Float[Array, "v k"],
        columns: Int[Array, "k"],
        priors: PriorRows,
        unit: Float[Array, "k"],
    ) -> Linear:
        """About the first of `values`; the next are `unit` of each beyond it, and before it."""

        def one(blur: GlassBlur, slope: GlassBlur, value: Array) -> tuple[Array, Array]:
            error, slopes = self._rows(blur, slope)
            slopes = slopes[:, columns]
            gradient = error @ slopes + priors(value) * priors.inverse
            return gradient, slopes.T @ slopes + jnp.diag(priors.inverse**2)

        gradients, normals = jax.vmap(one)(found.blur, found.slope, values)
        k = unit.size
        curvature = (gradients[1 : k + 1] - gradients[k + 1 : 2 * k + 1]) / (2.0 * unit[:, None])
        return Linear(gradients[0], normals[0], 0.5 * (curvature + curvature.T))

    def _rows(self, blur: GlassBlur, slope: GlassBlur) -> tuple[Float[Array, "m"], Float[Array, "m 2"]]:
        """Root of weight times errors, and slopes; of what is to be sharp its defocus and its spot."""
        points = self.points
        count = points.disparity.shape[0]
        size, size_slope = _size(blur, slope)
        miss = jnp.where(points.signed, self.sign, 1.0) * size[:count] - points.target
        slopes = jnp.where(points.signed, self.sign, 1.0)[:, None] * size_slope[:count]
        if self.other_sign is not None:
            follows = jnp.where(points.relation == SAME, jnp.where(points.signed, self.other_sign, 1.0), 0.0)
            miss = miss - follows * size[count:]
            slopes = slopes - follows[:, None] * size_slope[count:]
        sharp = wished_sharp(points)
        miss = jnp.where(sharp, blur.defocus[:count], miss)
        slopes = jnp.where(sharp[:, None], slope.defocus[:count], slopes)
        counts = self.on if points.quantity is None else self.on & (points.quantity == BLUR)
        root = root_weight(points.weight)
        rows, spots = jnp.where(counts, root, 0.0), jnp.where(sharp, root, 0.0)
        return (
            jnp.concatenate([rows * miss, spots * blur.spot[:count]]),
            jnp.concatenate([rows[:, None] * slopes, spots[:, None] * slope.spot[:count]]),
        )


def _size(blur: GlassBlur, slope: GlassBlur) -> tuple[Float[Array, "m"], Float[Array, "m 2"]]:
    """Diameters, and their slopes."""
    size = blur.size
    along = blur.defocus[:, None] * slope.defocus + blur.spot[:, None] * slope.spot
    return size, along / size[:, None]


def wished_sharp(points: ImagePoints) -> Bool[Array, "n"]:
    """Rows that wish for no blur at all."""
    sharp = (points.target == 0.0) & points.signed
    if points.relation is not None:
        sharp &= points.relation == EQUAL
    if points.quantity is not None:
        sharp &= points.quantity == BLUR
    return sharp


def placed(points: ImagePoints, blur: Float[Array, "n"]) -> Float[Array, "n"]:
    """What every row is about: its blur, or where it is shown."""
    if points.quantity is None:
        return blur
    return jnp.where(points.quantity == BLUR, blur, jnp.where(points.quantity == ACROSS, *points.xy.T))


def holding(points: ImagePoints, size: Float[Array, "n"]) -> Bool[Array, "n"]:
    """All rows but limits that are kept with room to spare."""
    if points.relation is None:
        return jnp.ones_like(points.signed)
    room = points.target - size
    return ~(
        ((points.relation == AT_MOST) & (room > _NEAR_PX))
        | ((points.relation == AT_LEAST) & (room < -_NEAR_PX))
    )
