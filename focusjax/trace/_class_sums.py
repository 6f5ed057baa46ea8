"""What rays bring, added up pixel by pixel for each class of blur.

Rays of a pixel meet few of many classes, so that sums of whole pictures are kept as sparse matrices.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from focusjax.lens import AbstractLens
from focusjax.trace._blur_classes import BlurClasses


def told_apart(lens: AbstractLens, classes: BlurClasses) -> int:
    """Numbers in a row of `class_sums`.

    For each class they are three of radiance, and one or three of weight.
    """
    return len(classes.least) * (6 if lens.channels() else 4) + 3


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


def added_up(
    parts: Sequence[tuple[Int[np.ndarray, " _"], csr_array]], shape: tuple[int, int], dtype: np.dtype
) -> csr_array:
    """A matrix of this shape, to whose rows those of `parts` are added, each to the one of its number.

    It may hold several numbers for one place, which count together.
    """
    index = np.dtype(np.int32 if sum(rows.nnz for _, rows in parts) < 1 << 31 else np.int64)
    ends = np.zeros(shape[0] + 1, dtype=index)
    for numbers, rows in parts:
        ends[numbers + 1] += np.diff(rows.indptr)
    np.cumsum(ends, out=ends)
    # So far each row is filled.
    filled = ends[:-1].copy()
    values, columns = np.empty(ends[-1], dtype=dtype), np.empty(ends[-1], dtype=index)
    for numbers, rows in parts:
        more = np.diff(rows.indptr)
        to = np.repeat(filled[numbers] - rows.indptr[:-1], more) + np.arange(rows.nnz)
        values[to], columns[to] = rows.data, rows.indices
        filled[numbers] += more
    return csr_array((values, columns, ends), shape=shape)


def by_class(sums: csr_array) -> tuple[csr_array, Float[np.ndarray, "p 3"]]:
    """Rows of `class_sums`, apart: what is told of all classes, and what is brighter than white."""
    return sums[:, :-3], sums[:, -3:].toarray()
