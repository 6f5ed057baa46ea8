"""What rays bring, added up pixel by pixel for each class of blur."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.lens import AbstractLens
from focusjax.trace._blur_classes import BlurClasses


def told_apart(lens: AbstractLens, classes: BlurClasses) -> tuple[int, int]:
    """Classes, and how many numbers are told of each: three of radiance, and of weight one or three."""
    return len(classes.least), 6 if lens.channels() else 4


def class_sums(
    along: Float[Array, "p s 3"],
    share: Float[Array, "p s"],
    disparity: Float[Array, "p s"],
    pixels: Int[Array, " p"],
    place: Int[Array, " p"],
    classes: BlurClasses,
    *,
    in_each: bool,
) -> Float[Array, "p k c"]:
    """Sums over all rays with the same `place`, 0 to p - 1; what has none counts for nothing.

    For each class it is weight times radiance, up to white, 1, in three colours, and weight; and at the end,
    for all classes, what is brighter than white. Along the last axis are the three colours if these are told
    `in_each`, for `in_colour` to mix; all is one row otherwise.

    Args:
        along: radiance.
        share: the weight of each ray.
        disparity: of what it meets, in 1/m.
        pixels: row-major number of the pixel that each row of rays is of.
        place: where it is added.
        classes: by which rays are told apart.
        in_each: whether weights may differ from colour to colour.
    """
    count, kinds = len(pixels), len(classes.least)

    def arrives(along: Float[Array, "p s 3"]) -> list[Float[Array, "p s"]]:
        # Each colour for itself: of large blocks XLA for CPU takes one for all in their product.
        return [share * along[..., k] for k in range(3)]

    def added(values: list[Float[Array, "p s"]], to: Int[Array, "p s"], kinds: int) -> Float[Array, "p _"]:
        rows = jnp.stack(values, axis=-1).reshape(-1, len(values))
        found = jax.ops.segment_sum(rows, to.reshape(-1), num_segments=count * kinds)
        return found.reshape(count, -1)

    whole, white = jnp.broadcast_to(place[:, None], share.shape), jnp.minimum(along, 1.0)
    told = arrives(white) + [share] * (3 if in_each else 1)
    in_classes = added(told, whole * kinds + classes.of(pixels, disparity), kinds)
    found = jnp.concatenate([in_classes, added(arrives(along - white), whole, 1)], axis=1)
    return found.reshape(count, -1, 3) if in_each else found[:, None]


def by_class(
    sums: Float[np.ndarray, "p n"], told: tuple[int, int]
) -> tuple[Float[np.ndarray, "p k c"], Float[np.ndarray, "p 3"]]:
    """Rows of `class_sums`, apart: what is told of each class, and what is brighter than white."""
    return sums[:, :-3].reshape(-1, *told), sums[:, -3:]
