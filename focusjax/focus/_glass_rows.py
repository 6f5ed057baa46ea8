"""Errors of wishes in the blur of glass, with their slopes, from what rays say of it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._glass_blur import Sensed
from focusjax.focus._image_points import (
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
        cost: itself.
        gradient: [k].
        normal: the products of slopes, which Gauss and Newton take for the curvature [k, k].
        curvature: by differences of gradients [k, k].
    """

    cost: Float[Array, ""]
    gradient: Float[Array, "k"]
    normal: Float[Array, "k k"]
    curvature: Float[Array, "k k"]


class GlassRows(eqx.Module):
    """What rows wish of the blur of glass. A limit that is kept with room to spare has no error."""

    points: ImagePoints

    def linear(
        self,
        found: Sensed,
        values: Float[Array, "v k"],
        columns: Int[Array, "k"],
        priors: PriorRows,
        unit: Float[Array, "k"],
    ) -> Linear:
        """About the first of `values`; the next are `unit` of each beyond it, and before it.

        All with the sides of the focus, and the limits that count, that the first has.
        """
        settled = jax.lax.stop_gradient(found.blur.signed[0])

        def one(found: Sensed, value: Array) -> tuple[Array, Array, Array]:
            error, slopes = self.rows(found, settled, columns, value, priors)
            return 0.5 * error @ error, error @ slopes, slopes.T @ slopes

        costs, gradients, normals = jax.vmap(one)(found, values)
        k = unit.size
        curvature = (gradients[1 : k + 1] - gradients[k + 1 : 2 * k + 1]) / (2.0 * unit[:, None])
        return Linear(costs[0], gradients[0], normals[0], 0.5 * (curvature + curvature.T))

    def gradient(
        self, found: Sensed, value: Float[Array, "k"], columns: Int[Array, "k"], priors: PriorRows
    ) -> Float[Array, "k"]:
        """That of half the sum of squared errors, of what is found at one setting."""
        settled = jax.lax.stop_gradient(found.blur.signed)
        error, slopes = self.rows(found, settled, columns, value, priors)
        return error @ slopes

    def _counting(self, size: Float[Array, "m"]) -> Bool[Array, "n"]:
        """Rows of blur with something to wish for; of limits those that are not kept with room to spare."""
        points = self.points
        count = points.disparity.shape[0]
        on = jnp.ones(count, dtype=bool) if points.quantity is None else points.quantity == BLUR
        if points.relation is None:
            return on
        room = points.target - jnp.where(points.signed, size[:count], jnp.abs(size[:count]))
        return on & ~(
            ((points.relation == AT_MOST) & (room > _NEAR_PX))
            | ((points.relation == AT_LEAST) & (room < -_NEAR_PX))
        )

    def rows(
        self,
        found: Sensed,
        settled: Float[Array, "m"],
        columns: Int[Array, "k"],
        value: Float[Array, "k"],
        priors: PriorRows,
    ) -> tuple[Float[Array, "r"], Float[Array, "r k"]]:
        """Residuals and their slopes: of wishes, of what is to be sharp its defocus and its spot, of priors.

        Blur is on the sides of the focus that `settled` says.
        """
        points, blur, slope = self.points, found.blur, found.slope
        count = points.disparity.shape[0]
        size, change = diameters(found)
        side = jnp.where(settled >= 0.0, 1.0, -1.0)
        turn = jnp.where(points.signed, side[:count], 1.0)
        miss, slopes = turn * size[:count] - points.target, turn[:, None] * change[:count]
        if points.reference is not None:
            follows = jnp.where(points.signed, side[count:], 1.0) * (points.relation == SAME)
            miss, slopes = miss - follows * size[count:], slopes - follows[:, None] * change[count:]
        sharp = wished_sharp(points)
        miss = jnp.where(sharp, blur.defocus[:count], miss)
        slopes = jnp.where(sharp[:, None], slope.defocus[:count], slopes)
        root, on = root_weight(points.weight), self._counting(settled)
        rows, spots = jnp.where(on, root, 0.0), jnp.where(sharp & on, root, 0.0)
        error = jnp.concatenate([rows * miss, spots * blur.spot[:count], priors(value)])
        wished = jnp.concatenate([rows[:, None] * slopes, spots[:, None] * slope.spot[:count]])
        return error, jnp.concatenate([wished[:, columns], jnp.diag(priors.inverse)])


def diameters(found: Sensed) -> tuple[Float[Array, "*v m"], Float[Array, "*v m 2"]]:
    """Of the blur, without signs, and their slopes."""
    blur, slope = found.blur, found.slope
    size = blur.size
    along = blur.defocus[..., None] * slope.defocus + blur.spot[..., None] * slope.spot
    return size, along / size[..., None]


def wished_sharp(points: ImagePoints) -> Bool[Array, "n"]:
    """Rows that wish for no blur at all."""
    sharp = (points.target == 0.0) & points.signed
    if points.relation is not None:
        sharp &= points.relation == EQUAL
    if points.quantity is not None:
        sharp &= points.quantity == BLUR
    return sharp
