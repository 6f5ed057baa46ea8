"""Triangles cut into square stamps of samples, the unit of work of the rasteriser.

Sample centres are half-integers. Over a triangle with corners p_i, the function

    e_i(x, y) = distance to the side opposite p_i in samples, positive inside,

tells coverage; divided by the height h_i over that side it is the screen barycentric weight of p_i,
so that the disparity, affine on screen, is w = sum e_i w_i / h_i. Coefficients are made relative to
each stamp's own origin, so that single precision holds them to about 1e-6 samples; those of diced
triangles, whose corners may be far away, are made in double precision.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._parallel import in_parallel
from focusjax.layers._blocks import in_blocks
from focusjax.layers._boxes import Boxes
from focusjax.layers._clip import ScreenTriangles

SIZES = (1, 2, 4, 8, 16)
"""Edge lengths of stamps in samples; a larger triangle is diced into several of the last size."""

_AT_ONCE = 1 << 14
_SAMPLES_AT_ONCE = 1 << 25
"""In the boxes that one call dices, of which one may be larger: a hundred thousand of the largest stamps."""


@dataclasses.dataclass(frozen=True)
class Stamps:
    """Stamps, ordered by size.

    Attributes:
        counts: number of stamps of each of `SIZES`.
        origin: column and row [n, 2] of the first sample.
        edges: coefficients [n, 3, 3] of e_i = (x, y, 1) . edges_i, x and y counted in samples
            from the first sample's centre.
        disparity: w_i / h_i of the corners [n, 3], in dioptres per sample.
        bounds: least and largest corner disparity [n, 2].
        triangle: index [n] into the screen triangles.
    """

    counts: tuple[int, ...]
    origin: np.ndarray
    edges: np.ndarray
    disparity: np.ndarray
    bounds: np.ndarray
    triangle: np.ndarray


def dice(triangles: ScreenTriangles, boxes: Sequence[Boxes], *, reach: float = 0.0) -> Stamps:
    """All stamps that may hold a sample of `boxes`, made for the same `reach`, that its triangle touches."""

    def some(part: Boxes) -> list[tuple[np.ndarray, ...]]:
        size = _stamp_size(part.span)
        sorted_by_size = []
        for edge_length in SIZES:
            chosen = np.flatnonzero(size == edge_length)
            which, begins, extends = (
                np.take(a, chosen, axis=0) for a in (part.triangle, part.first, part.span)
            )
            corners = np.take(triangles.points, np.take(triangles.faces, which, axis=0), axis=0)
            sorted_by_size.append(_stamps_of_size(edge_length, which, corners, begins, extends, reach))
        return sorted_by_size

    # Large triangles are looked at in many stamps before those that they miss are left out.
    work = [less for part in boxes for less in part.portions(part.samples, _SAMPLES_AT_ONCE)]
    # An empty part gives the arrays their types where there are no triangles at all.
    nothing = np.zeros((0, 2), dtype=np.int32)
    found = in_parallel(some, work) or [some(Boxes(np.zeros(0, dtype=np.intp), nothing, nothing))]
    by_size = list(zip(*found, strict=True))
    counts = tuple(sum(len(stamps[-1]) for stamps in of_size) for of_size in by_size)
    fields = zip(*(stamps for of_size in by_size for stamps in of_size), strict=True)
    return Stamps(counts, *(np.concatenate(field) for field in fields))


def _edge_functions(corners: Any, xp: Any) -> tuple[Any, Any]:
    """Coefficients [t, 3, 3] of the distances (x, y, 1) to the sides, and w_i / h_i [t, 3].

    Edge-on and zero-area triangles cover nothing, as in any rasteriser: their distances are -inf.
    `xp` is the array library, numpy or jax.numpy.
    """
    x, y, w = (corners[..., k] for k in range(3))
    doubled_area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (y[:, 1] - y[:, 0]) * (x[:, 2] - x[:, 0])
    flat = xp.abs(doubled_area) <= 1e-10
    doubled_area = xp.where(flat, 1.0, doubled_area)
    sign = xp.sign(doubled_area)
    rows, heights = [], []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        dx, dy = x[:, k] - x[:, j], y[:, k] - y[:, j]
        length = xp.sqrt(dx * dx + dy * dy)
        scale = sign / xp.where(flat, 1.0, length)
        normal_x, normal_y = -dy * scale, dx * scale
        offset = -(normal_x * x[:, j] + normal_y * y[:, j])
        rows.append(xp.stack([normal_x, normal_y, xp.where(flat, -xp.inf, offset)], axis=-1))
        heights.append(w[:, i] * length / xp.abs(doubled_area))
    return xp.stack(rows, axis=1), xp.stack(heights, axis=1)


@jax.jit
def _edge_functions_block(corners: Float[Array, "t 3 3"]) -> tuple[Array, Array]:
    return _edge_functions(corners, jnp)


def _edge_functions_single(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same in single precision, in blocks, so that it is compiled once."""
    return in_blocks(_edge_functions_block, (corners.astype(np.float32),), _AT_ONCE)


def _stamp_size(span: np.ndarray) -> np.ndarray:
    """Smallest stamp that covers each box of `span` [t, 2] samples with at most four stamps."""
    size = np.full(len(span), SIZES[-1], dtype=np.int32)
    for edge_length in SIZES[-2::-1]:
        across, down = (-(-span[:, k] // edge_length) for k in (0, 1))
        size[across * down <= (1 if edge_length <= 2 else 4)] = edge_length
    return size


def _stamps_of_size(
    size: int, index: np.ndarray, corners: np.ndarray, first: np.ndarray, span: np.ndarray, reach: float
) -> tuple[np.ndarray, ...]:
    """The arrays of `Stamps`, from `origin` on, for triangles `index` of one stamp size."""
    across, down = -(-span[:, 0] // size), -(-span[:, 1] // size)
    count = across * down
    owner = np.repeat(np.arange(len(index), dtype=np.int32), count)
    tile = np.arange(len(owner), dtype=np.int32) - np.repeat(np.cumsum(count) - count, count)
    origin = np.take(first, owner, axis=0)
    if len(owner) > len(index):
        origin = origin + size * np.stack([tile % across[owner], tile // across[owner]], axis=1)
    local = np.take(corners, owner, axis=0)
    local[:, :, 0] -= origin[:, :1] + 0.5
    local[:, :, 1] -= origin[:, 1:] + 0.5
    edges, disparity = _edge_functions(local, np) if size == SIZES[-1] else _edge_functions_single(local)
    if size > 2:
        # A stamp wholly outside one side holds nothing: keep those whose best corner is inside all.
        best = edges[..., 2] + (size - 1) * (np.maximum(edges[..., 0], 0) + np.maximum(edges[..., 1], 0))
        if reach:
            best += reach * (np.abs(edges[..., 0]) + np.abs(edges[..., 1]))
        kept = np.flatnonzero((best[:, 0] >= -1e-4) & (best[:, 1] >= -1e-4) & (best[:, 2] >= -1e-4))
        owner = owner[kept]
        origin, local, edges, disparity = (
            np.take(a, kept, axis=0) for a in (origin, local, edges, disparity)
        )
    w = local[..., 2].astype(np.float32)
    bounds = [op(op(w[:, 0], w[:, 1]), w[:, 2]) for op in (np.minimum, np.maximum)]
    return (
        origin.astype(np.int32),
        edges.astype(np.float32),
        disparity.astype(np.float32),
        np.stack(bounds, axis=1),
        index[owner].astype(np.int32),
    )
