"""How far beyond the picture's border the layers must reach for every lens ray to find its surface.

A ray of a film point leaves it, at disparity w, by at most the lens's footprint radius r(w). So a
surface point outside the frame matters exactly when its distance to the frame is within r(w).
"""

from collections.abc import Callable

import numpy as np

from focusjax._parallel import in_parallel, parts
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid

_ROUNDS = 40
_MOST_PIECES = 200_000
_AT_ONCE = 1 << 17
_SLACK = 1.0
"""Samples by which the answer may be too large; never too small."""


def leaving(triangles: ScreenTriangles, frame: Grid) -> np.ndarray:
    """Which triangles [n] have a corner outside the frame."""
    x, y = triangles.points[:, 0], triangles.points[:, 1]
    outside = (x < 0) | (x > frame.columns) | (y < 0) | (y > frame.rows)

    def some(part: slice) -> np.ndarray:
        first, second, third = (np.take(outside, corner[part]) for corner in triangles.faces.T)
        return part.start + np.flatnonzero(first | second | third)

    found = in_parallel(some, parts(triangles.count, _AT_ONCE))
    return np.concatenate([np.zeros(0, dtype=np.intp), *found])


def reachable(
    triangles: ScreenTriangles, frame: Grid, reach: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Mask [t] of the triangles whose bounding box some lens ray may touch.

    Args:
        triangles: in grid coordinates of `frame`.
        frame: the picture without margin.
        reach: footprint radius in samples for disparities; convex, as rays are lines in disparity.
    """

    def some(part: slice) -> np.ndarray:
        gap = _gap(triangles.span(0, part), triangles.span(1, part), frame)
        outside = np.flatnonzero(gap > 0)
        mask = gap <= 0
        corners = triangles.points[triangles.faces[part][outside]]
        mask[outside] = gap[outside] <= _widest_reach(corners, reach)
        return mask

    return np.concatenate([np.zeros(0, dtype=bool), *in_parallel(some, parts(triangles.count, _AT_ONCE))])


def needed_margin(
    triangles: ScreenTriangles, frame: Grid, reach: Callable[[np.ndarray], np.ndarray]
) -> float:
    """Samples of margin that hold every point of `triangles` that lens rays can reach.

    Corners give a lower bound and whole triangles an upper one; triangles that could still raise the
    bound are split in (x, y, w), where they stay flat, until the two bounds are within one
    sample. A ground plane that runs under the camera comes close to the lens, where blur is
    huge, but outside the frame by even more: only splitting shows whether rays reach it.
    """
    corners = triangles.take(leaving(triangles, frame)).corners
    best, upper = 0.0, np.zeros(0)
    for _ in range(_ROUNDS):
        if not len(corners):
            break
        outside = _distance_outside(corners, frame)
        radius = reach(corners[..., 2])
        best = max(best, float(np.max(np.where(outside <= radius, outside, 0.0))))
        least, widest = _overshoot_bounds(corners, frame), _widest_reach(corners, reach)
        upper = np.where(least <= widest, np.minimum(widest, outside.max(axis=1)), 0.0)
        corners, upper = corners[upper > best + _SLACK], upper[upper > best + _SLACK]
        if len(corners) > _MOST_PIECES:
            break
        corners = _split(corners)
    return max(best + _SLACK, float(upper.max(initial=0.0)))


def _distance_outside(points: np.ndarray, frame: Grid) -> np.ndarray:
    """Distance (max norm) of image points [..., 2+] from the frame; 0 inside."""
    x, y = points[..., 0], points[..., 1]
    wide, high = frame.columns, frame.rows
    return np.maximum.reduce([-x, x - wide, -y, y - high, np.zeros_like(x)])


def _overshoot_bounds(corners: np.ndarray, frame: Grid) -> np.ndarray:
    """Least distance from the frame over each triangle's bounding box [t]."""
    x, y = corners[..., 0], corners[..., 1]
    return _gap((-_most(-x), _most(x)), (-_most(-y), _most(y)), frame)


def _gap(x: tuple[np.ndarray, np.ndarray], y: tuple[np.ndarray, np.ndarray], frame: Grid) -> np.ndarray:
    """Distance (max norm) of boxes, given by least and largest x and y [t], from the frame."""
    across = np.maximum(-x[1], x[0] - frame.columns)
    down = np.maximum(-y[1], y[0] - frame.rows)
    return np.maximum(np.maximum(across, down), 0.0)


def _most(a: np.ndarray) -> np.ndarray:
    """Largest of the three columns; numpy's reduction over so short an axis is ten times slower."""
    return np.maximum(np.maximum(a[:, 0], a[:, 1]), a[:, 2])


def _widest_reach(corners: np.ndarray, reach: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Largest footprint radius over each triangle [t]; a convex function peaks at a corner."""
    return _most(reach(corners[..., 2]))


def _split(corners: np.ndarray) -> np.ndarray:
    """The two halves of each triangle [2 t, 3, 3], cut across its longest side on screen."""
    side = corners[:, [1, 2, 0]] - corners
    longest = np.argmax((side[..., :2] ** 2).sum(axis=-1), axis=1)
    order = (longest[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[..., None], axis=1), 1, 0)
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
