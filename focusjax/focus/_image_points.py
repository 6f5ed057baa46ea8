"""Wishes after they have been found in the picture: all that the solve needs to know."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.geometry import Camera
from focusjax.lens import AbstractLens


class ImagePoints(eqx.Module):
    """One row per point; a wish about an object has several rows that share its weight.

    A pytree: solutions can be differentiated with respect to the float fields.

    Attributes:
        xy: image positions in pixels.
        disparity: 1 / depth along the view axis, in 1/m; 0 at infinity.
        target: wished blur diameter in pixels, signed when `signed`, else not negative.
        signed: whether the wish says on which side of the focus the point is to be.
        weight: factor of the squared error in pixels.
        tolerance: error in pixels up to which the wish is met.
        wish: which wish the row belongs to, as an index into `names`.
        names: one name per wish (static).
    """

    xy: Float[Array, "n 2"]
    disparity: Float[Array, "n"]
    target: Float[Array, "n"]
    signed: Bool[Array, "n"]
    weight: Float[Array, "n"]
    tolerance: Float[Array, "n"]
    wish: Int[Array, "n"]
    names: tuple[str, ...] = eqx.field(static=True)


def blurs(points: ImagePoints, camera: Camera, lens: AbstractLens) -> Float[Array, "n"]:
    """Signed blur diameter in pixels that `lens` gives to every point."""
    return jax.vmap(lambda xy, disparity: lens.blur(camera, xy, disparity))(points.xy, points.disparity)


def errors(points: ImagePoints, camera: Camera, lens: AbstractLens) -> Float[Array, "n"]:
    """How far each point's blur is from its wish, in pixels.

    The error is blur - target when the wish is signed and |blur| - target otherwise; positive means
    too much blur for an unsigned wish. A sharp wish is signed with target 0, so it is smooth.
    """
    blur = blurs(points, camera, lens)
    return jnp.where(points.signed, blur, jnp.abs(blur)) - points.target


def residuals(points: ImagePoints, camera: Camera, lens: AbstractLens) -> Float[Array, "n"]:
    """sqrt(weight) x error in pixels: the solve minimises half the sum of their squares.

    The slope of an unsigned wish at blur 0, where it has a peak, is taken as 0.
    """
    return root_weight(points.weight) * errors(points, camera, lens)


def root_weight(weight: Float[Array, "n"]) -> Float[Array, "n"]:
    """The square root; its slope is infinite at weight 0, where 0 is reported instead."""
    counts = weight > 0
    return jnp.where(counts, jnp.sqrt(jnp.where(counts, weight, 1.0)), 0.0)
