"""Triangles on screen: cut at the near plane, so that each has a projection, and what they cover.

Over a triangle with corners p_i, the function

    e_i(x, y) = distance to the side opposite p_i in samples, positive inside,

gives coverage by its sign; divided by the height h_i over that side it is the screen barycentric weight of
p_i, so that the disparity, affine on screen, is w = sum e_i w_i / h_i. Places are counted from an origin near
the triangle, so that single precision holds them to about 1e-6 samples; those of triangles whose corners
may be far away are made in double precision.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

TOLERANCE = 1e-5
"""Samples by which a triangle is fattened, so that rounding opens no crack between neighbours."""
Edges = tuple[tuple[Any, Any, Any, Any], ...]
"""For each corner i the coefficients [n] of e_i = across x + down y + offset, and the scale w_i / h_i."""


@dataclasses.dataclass(frozen=True)
class ScreenTriangles:
    """Triangles in image space, where planes stay planes and disparity is affine.

    Columns of `points` and `faces` lie together in memory: nearly all that reads them reads one at a time.

    Attributes:
        points: grid x, grid y and disparity [v, 3].
        faces: the three corners [t, 3], rows of `points`.
        source: index [t] of the scene's face each one is a part of.
        unclipped: the first so many triangles are whole faces.
        weights: barycentric weights [t - unclipped, 3 corners, 3] of the other ones' corners in
            their source faces.
    """

    points: np.ndarray
    faces: np.ndarray
    source: np.ndarray
    unclipped: int
    weights: np.ndarray

    def take(self, index: np.ndarray) -> "ScreenTriangles":
        """The triangles at the increasing positions `index`."""
        unclipped = int(np.searchsorted(index, self.unclipped))
        weights = self.weights[index[unclipped:] - self.unclipped]
        faces = np.stack([np.take(corner, index) for corner in self.faces.T]).T
        return ScreenTriangles(self.points, faces, np.take(self.source, index), unclipped, weights)

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @property
    def corners(self) -> np.ndarray:
        """Grid x, grid y and disparity of the three corners [t, 3, 3]."""
        return self.points[self.faces]

    @functools.cached_property
    def quarters(self) -> tuple[np.ndarray, np.ndarray]:
        """Grid x and y [v] in quarters of a sample, odd where they are neither whole nor half.

        They decide on which side of a point centres and squares of samples lie. What is within `TOLERANCE`
        of whole or half counts as that: where two surfaces meet, a corner that they share may be rounded
        to either side of a centre, which would be in the box of neither.
        """
        far, fat = 1 << 28, 2 * TOLERANCE
        doubled = (np.clip(2.0 * self.points[:, k], -far, far) for k in (0, 1))
        x, y = ((np.floor(a + fat) + np.ceil(a - fat)).astype(np.int32) for a in doubled)
        return x, y

    def around(
        self, index: np.ndarray, column: np.ndarray, row: np.ndarray
    ) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Grid x, grid y and disparity of the three corners, [n] each, of the triangles `index`.

        The places are counted from the centres of the samples in the columns and rows given.
        """
        corners = [np.take(corner, index) for corner in self.faces.T]
        x, y, w = (tuple(np.take(values, corner) for corner in corners) for values in self.points.T)
        across, down = column + 0.5, row + 0.5
        return tuple(a - across for a in x), tuple(a - down for a in y), w

    def span(
        self, axis: int, part: slice | np.ndarray, *, quarters: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest x (0), y (1) or disparity (2) [t] over the corners of some triangles.

        Places are in samples or, of x and y, in `quarters`.
        """
        values = self.quarters[axis] if quarters else self.points[:, axis]
        first, second, third = (np.take(values, corner[part]) for corner in self.faces.T)
        return (
            np.minimum(np.minimum(first, second), third),
            np.maximum(np.maximum(first, second), third),
        )


def clip_to_near(homogeneous: np.ndarray, faces: np.ndarray, near: float) -> ScreenTriangles:
    """Triangles in front of the near plane, those that cross it cut along it.

    Homogeneous image points are linear in space, so the edge from corner i (ahead) to corner j
    (behind) meets the plane at weight t = (z_i - near) / (z_i - z_j) of corner j.

    `homogeneous` are image points (x z, y z, z) [v, 3], `faces` rows of them [t, 3], and `near` is the depth
    of the plane in metres, above 0.
    """
    in_front = homogeneous[:, 2] >= near
    if in_front.all():
        # The usual case; it touches no triangle.
        everything = np.arange(len(faces), dtype=np.int32)
        whole = faces.astype(np.int32, order="F", copy=False)
        return ScreenTriangles(_projected(homogeneous), whole, everything, len(faces), np.zeros((0, 3, 3)))
    ahead = in_front[faces]
    count = ahead.sum(axis=1)
    whole = np.flatnonzero(count == 3)
    points, kept_faces, sources = [homogeneous], [faces[whole]], [whole]
    weights = [np.zeros((0, 3, 3))]
    number = len(homogeneous)
    for kept in (1, 2):
        crossing = np.flatnonzero(count == kept)
        if len(crossing):
            for polygon_points, polygon_weights in _cut(homogeneous, faces, ahead, crossing, near):
                points.append(polygon_points.reshape(-1, 3))
                kept_faces.append(number + np.arange(3 * len(crossing)).reshape(-1, 3))
                number += 3 * len(crossing)
                weights.append(polygon_weights)
                sources.append(crossing)
    return ScreenTriangles(
        points=_projected(np.concatenate(points)),
        faces=np.concatenate(kept_faces).astype(np.int32, order="F"),
        source=np.concatenate(sources).astype(np.int32),
        unclipped=len(whole),
        weights=np.concatenate(weights),
    )


def _projected(homogeneous: np.ndarray) -> np.ndarray:
    """Grid x, grid y and disparity [n, 3]; of points at or behind the lens plane, which no face uses, 0."""
    z = homogeneous[:, 2]
    disparity = np.divide(1.0, z, out=np.zeros_like(z), where=z > 0)
    return np.stack([homogeneous[:, 0] * disparity, homogeneous[:, 1] * disparity, disparity]).T


def _cut(
    homogeneous: np.ndarray, faces: np.ndarray, ahead: np.ndarray, crossing: np.ndarray, near: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """What is left of the faces in `crossing`, all with one corner ahead or all with two.

    Each entry holds the corners' homogeneous points [n, 3, 3] and barycentric weights [n, 3, 3].
    """
    one_ahead = ahead[crossing[0]].sum() == 1
    # Turn each face so that its odd corner comes first: the one ahead, or the one behind.
    odd = np.argmax(ahead[crossing] == one_ahead, axis=1)
    order = (odd[:, None] + np.arange(3)) % 3
    point = homogeneous[np.take_along_axis(faces[crossing], order, axis=1)]
    unit = np.eye(3)[order]

    def on_near(corner: int) -> tuple[np.ndarray, np.ndarray]:
        depth, other = point[:, 0, 2], point[:, corner, 2]
        t = ((depth - near) / (depth - other))[:, None]
        return (1 - t) * point[:, 0] + t * point[:, corner], (1 - t) * unit[:, 0] + t * unit[:, corner]

    first, second = on_near(1), on_near(2)
    corners = [(point[:, i], unit[:, i]) for i in range(3)]
    if one_ahead:
        polygons = [(corners[0], first, second)]
    else:
        polygons = [(first, corners[1], corners[2]), (first, corners[2], second)]
    return [
        (np.stack([p for p, _ in polygon], axis=1), np.stack([b for _, b in polygon], axis=1))
        for polygon in polygons
    ]


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
