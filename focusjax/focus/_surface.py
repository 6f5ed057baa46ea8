"""Points spread over an object's surface, so that a wish can be about the whole object."""

import numpy as np
from jaxtyping import Float, Int

# The plastic number's powers: the two-dimensional counterpart of the golden ratio, whose
# multiples modulo 1 fill the square more evenly than random numbers.
_PLASTIC = 1.32471795724474602596


def surface_samples(corners: Float[np.ndarray, "t 3 3"], count: int) -> Float[np.ndarray, "n 3"]:
    """`count` points spread over triangles in proportion to their area; the same every time.

    Args:
        corners: triangle, corner, coordinate in metres.
        count: number of points n.

    Returns:
        Points in metres; none when the triangles have no area.
    """
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)
    total = area.sum()
    if not total > 0:
        return np.zeros((0, 3))
    # Equal steps along the summed area: every triangle gets its share to within one point.
    steps = (np.arange(count) + 0.5) / count * total
    triangle = np.minimum(np.searchsorted(np.cumsum(area), steps), len(area) - 1)
    barycentric = _barycentric(np.arange(count))
    return np.einsum("nk,nkx->nx", barycentric, corners[triangle])


def _barycentric(index: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """Well-spread barycentric weights: the unit square folded along its diagonal."""
    u = (0.5 + index / _PLASTIC) % 1.0
    v = (0.5 + index / _PLASTIC**2) % 1.0
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    return np.stack([1.0 - u - v, u, v], axis=-1)


def thin_out(count: int, keep: int) -> Int[np.ndarray, "n"]:
    """Indices of at most `keep` out of `count` items, evenly spaced."""
    if count <= keep:
        return np.arange(count)
    return np.floor((np.arange(keep) + 0.5) * count / keep).astype(int)
