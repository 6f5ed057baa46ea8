"""Triangles of a depth map: every pixel its own square, so that the sharp view is the photograph again.

The corner of a square has the mean disparity of those of the four pixels around it that continue the
square's own. A surface so is watertight, and ends along pixel edges where it is torn. Disparity is affine in
the picture over a plane, so that squares of 2^k x 2^k pixels whose inner corners lie within `TOLERANCE`
pixels of blur of two triangles become those two: few where a surface is smooth. Where large squares meet
small ones the surfaces differ by as little, and there is no gap seen from the lens centre.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from focusjax.photo._tears import Links

TOLERANCE = 0.05
"""Pixels at the lens rim by which merged squares may be off."""
_BENT = 0.02
"""Pixels by which a texture may be off inside a merged square: perspective bends it over a slope."""
_LEVELS = 5


@dataclass(frozen=True)
class Squares:
    """Squares of pixels, each of which becomes two triangles.

    Attributes:
        column: left edge [n] in pixels.
        row: upper edge [n].
        size: edge length [n] in pixels.
        corners: disparity [n, 4] of the upper left, upper right, lower left and lower right corner.
    """

    column: Int[np.ndarray, "n"]
    row: Int[np.ndarray, "n"]
    size: Int[np.ndarray, "n"]
    corners: Float[np.ndarray, "n 4"]


def squares(
    disparity: Float[np.ndarray, "h w"], joined: Links, there: Bool[np.ndarray, "h w"], parallax: float
) -> Squares:
    """The squares of the pixels that are `there`."""
    corners, whole = _corners(disparity, joined)
    nodes = _nodes(corners)
    taken = np.zeros(there.shape, dtype=bool)
    parts = []
    for level in range(_LEVELS, 0, -1):
        size = 1 << level
        row, column = _merged(nodes, whole & there & ~taken, size, parallax)
        for dy in range(size):
            for dx in range(size):
                taken[row + dy, column + dx] = True
        values = [nodes[row + dy, column + dx] for dy in (0, size) for dx in (0, size)]
        parts.append((column, row, np.full(len(row), size), np.stack(values, axis=1)))
    row, column = np.nonzero(there & ~taken)
    parts.append((column, row, np.ones(len(row), dtype=int), corners[:, row, column].T))
    return Squares(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _nodes(corners: Float[np.ndarray, "4 h w"]) -> Float[np.ndarray, "_ _"]:
    """The corners of all pixels as one grid, of use where all pixels around each continue one another."""
    nodes = np.empty((corners.shape[1] + 1, corners.shape[2] + 1), dtype=corners.dtype)
    nodes[1:, 1:] = corners[3]
    nodes[:-1, 1:] = corners[1]
    nodes[1:, :-1] = corners[2]
    nodes[:-1, :-1] = corners[0]
    return nodes


def _corners(
    disparity: Float[np.ndarray, "h w"], joined: Links
) -> tuple[Float[np.ndarray, "4 h w"], Bool[np.ndarray, "h w"]]:
    """Disparity at the four corners of every pixel, and whether all pixels around continue it."""
    height, width = disparity.shape
    framed = np.pad(disparity, 1)
    across = np.pad(joined.across, ((1, 1), (1, 1)))
    down = np.pad(joined.down, ((1, 1), (1, 1)))
    found, whole = [], np.ones(disparity.shape, dtype=bool)
    inner = np.s_[1 : height + 1, 1 : width + 1]
    for dy in (-1, 1):
        for dx in (-1, 1):

            def moved(a: np.ndarray, y: int, x: int) -> np.ndarray:
                return a[1 + y : 1 + y + height, 1 + x : 1 + x + width]

            # Links from the pixel sideways and up or down, and from there to the one across the corner.
            side = moved(across, 0, min(dx, 0))
            above = moved(down, min(dy, 0), 0)
            side_then = moved(down, min(dy, 0), dx)
            above_then = moved(across, dy, min(dx, 0))
            opposite = (side & side_then) | (above & above_then)
            by_side = side | (above & above_then & side_then)
            by_above = above | (side & side_then & above_then)
            total, count = framed[inner].copy(), np.ones(disparity.shape, dtype=disparity.dtype)
            for ok, y, x in ((by_side, 0, dx), (by_above, dy, 0), (opposite, dy, dx)):
                total += np.where(ok, moved(framed, y, x), 0.0)
                count += ok
            found.append(total / count)
            whole &= by_side & by_above & opposite
    return np.stack(found), whole


def _merged(
    nodes: Float[np.ndarray, "_ _"], free: Bool[np.ndarray, "h w"], size: int, parallax: float
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Row and column of the aligned squares of `size` pixels that may become two triangles."""
    height, width = (edge // size for edge in free.shape)
    blocks = free[: height * size, : width * size].reshape(height, size, width, size).all(axis=(1, 3))
    row, column = np.nonzero(blocks)
    row, column = row * size, column * size
    first, right, below, last = (nodes[row + y, column + x] for y in (0, size) for x in (0, size))
    least = np.minimum(np.minimum(first, right), np.minimum(below, last))
    most = np.maximum(np.maximum(first, right), np.maximum(below, last))
    good = size * (most - least) <= 4 * _BENT * least
    for dy in range(size + 1):
        for dx in range(size + 1):
            down, over = dy / size, dx / size
            # The diagonal runs from the upper right to the lower left corner.
            if down + over <= 1:
                plane = first + over * (right - first) + down * (below - first)
            else:
                plane = last + (1 - over) * (below - last) + (1 - down) * (right - last)
            good &= parallax * np.abs(nodes[row + dy, column + dx] - plane) <= TOLERANCE
    return row[good], column[good]


def triangles(
    some: Squares, columns: int, *, shared: bool
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Corners as (x, y, disparity) in pixels and 1/m, and faces of them, counter-clockwise from the camera.

    Corners are there once, of a grid of `columns` pixels, or four times a square where they are not `shared`.
    """
    count = len(some.row)
    x = (some.column[:, None] + some.size[:, None] * np.array([0, 1, 0, 1])).ravel()
    y = (some.row[:, None] + some.size[:, None] * np.array([0, 0, 1, 1])).ravel()
    corners = np.stack([x, y, some.corners.ravel()], axis=1)
    number = np.arange(4 * count, dtype=np.int32)
    if shared:
        # The same corner of two squares is one vertex where they agree.
        place, w = y.astype(np.int64) * (columns + 1) + x, some.corners.ravel()
        order = np.lexsort((w, place))
        new = np.ones(len(order), dtype=bool)
        new[1:] = (np.diff(place[order]) != 0) | (np.diff(w[order]) != 0)
        number[order] = np.cumsum(new) - 1
        corners = corners[order[new]]
    corner = number.reshape(count, 4)
    return corners, np.concatenate([corner[:, [0, 2, 1]], corner[:, [1, 2, 3]]])
