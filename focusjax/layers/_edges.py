"""What a triangle covers on screen, and its disparity there, as functions of the place.

Over a triangle with corners p_i, the function

    e_i(x, y) = distance to the side opposite p_i in samples, positive inside,

gives coverage by its sign; divided by the height h_i over that side it is the screen barycentric weight of
p_i, so that the disparity, affine on screen, is w = sum e_i w_i / h_i. Places are counted from an origin near
the triangle, so that single precision holds them to about 1e-6 samples; those of triangles whose corners
may be far away are made in double precision.
"""

from collections.abc import Sequence
from typing import Any

Edges = tuple[tuple[Any, Any, Any, Any], ...]
"""For each corner i the coefficients [n] of e_i = across x + down y + offset, and the scale w_i / h_i."""


def edge_functions(x: Sequence[Any], y: Sequence[Any], w: Sequence[Any], xp: Any) -> Edges:
    """The functions of n triangles from the x, y and disparity, [n] each, of their three corners.

    Edge-on and zero-area triangles cover nothing, as in any rasteriser: their distances are -inf.
    `xp` is the array library, numpy or jax.numpy.
    """
    doubled_area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    flat = xp.abs(doubled_area) <= 1e-10
    doubled_area = xp.where(flat, 1.0, doubled_area)
    sign, size = xp.sign(doubled_area), xp.abs(doubled_area)
    edges = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        dx, dy = x[k] - x[j], y[k] - y[j]
        length = xp.sqrt(dx * dx + dy * dy)
        scale = sign / xp.where(flat, 1.0, length)
        across, down = -dy * scale, dx * scale
        offset = xp.where(flat, -xp.inf, -(across * x[j] + down * y[j]))
        edges.append((across, down, offset, w[i] * length / size))
    return tuple(edges)
