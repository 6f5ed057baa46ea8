"""Boxes of samples around triangles: what a rasteriser may have to look at, known before it does."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from focusjax._parallel import in_parallel, parts
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid

_AT_ONCE = 1 << 15
_ROWS = 16
"""Lines on which a triangle's width is measured; its area is within 1 % of them."""


@dataclasses.dataclass(frozen=True)
class Boxes:
    """Boxes of some triangles, none of them empty.

    Attributes:
        triangle: index [b] into the screen triangles, increasing.
        first: column and row [b, 2] of the first sample.
        span: number of columns and rows [b, 2].
    """

    triangle: np.ndarray
    first: np.ndarray
    span: np.ndarray

    @property
    def samples(self) -> Float[np.ndarray, " b"]:
        """How many samples are in each."""
        return self.span[:, 0].astype(float) * self.span[:, 1]

    def take(self, index: np.ndarray) -> "Boxes":
        """The boxes at the positions `index`."""
        return Boxes(*(np.take(a, index, axis=0) for a in (self.triangle, self.first, self.span)))

    def portions(self, cost: Float[np.ndarray, " b"], most: float) -> Iterator["Boxes"]:
        """The same in turns that cost no more than `most`, or are of one box."""
        spent = np.cumsum(cost)
        start = 0
        while start < len(spent):
            before = spent[start - 1] if start else 0.0
            stop = max(start + 1, int(np.searchsorted(spent, before + most, side="right")))
            yield Boxes(self.triangle[start:stop], self.first[start:stop], self.span[start:stop])
            start = stop


def boxes_on(grid: Grid, triangles: ScreenTriangles, *, reach: float = 0.0) -> list[Boxes]:
    """Boxes of the samples of `grid` whose square of half-width `reach` a triangle may touch.

    With a reach of 0 these are the samples whose centre it may cover.
    """

    def some(part: slice) -> Boxes:
        columns = _samples(triangles.span(0, part), grid.columns, reach)
        rows = _samples(triangles.span(1, part), grid.rows, reach)
        index = np.flatnonzero((columns[1] > 0) & (rows[1] > 0))
        first, span = (np.stack([columns[k][index], rows[k][index]], axis=1) for k in (0, 1))
        return Boxes((part.start + index).astype(np.int32), first, span)

    return in_parallel(some, parts(triangles.count, _AT_ONCE))


def _samples(span: tuple[np.ndarray, np.ndarray], limit: int, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """First sample [t] whose centre is within `reach` of an interval, and how many there are."""
    first = np.clip(np.ceil(span[0] - 0.5 - reach), 0, limit).astype(np.int32)
    return first, np.clip(np.floor(span[1] - 0.5 + reach), -1, limit - 1).astype(np.int32) - first + 1


def covered_area(grid: Grid, triangles: ScreenTriangles, boxes: Sequence[Boxes]) -> float:
    """Area in samples that the triangles of `boxes` cover on `grid`, each counted by itself."""
    return sum(in_parallel(lambda some: _covered_area(grid, triangles, some), boxes))


def _covered_area(grid: Grid, triangles: ScreenTriangles, boxes: Boxes) -> float:
    corners = triangles.points[triangles.faces[boxes.triangle]]
    x, y = corners[..., 0], corners[..., 1]
    top, bottom = (np.clip(end, 0, grid.rows) for end in (y.min(axis=1), y.max(axis=1)))
    height = (bottom - top) / _ROWS
    left, right = np.full((2, _ROWS, len(x)), [[[np.inf]], [[-np.inf]]])
    line = top + height * (np.arange(_ROWS)[:, None] + 0.5)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        rise = y[:, second] - y[:, first]
        share = (line - y[:, first]) / np.where(rise == 0, 1.0, rise)
        crossed = (rise != 0) & (share >= 0) & (share <= 1)
        place = x[:, first] + share * (x[:, second] - x[:, first])
        left = np.minimum(left, np.where(crossed, place, np.inf))
        right = np.maximum(right, np.where(crossed, place, -np.inf))
    width = np.clip(right, 0, grid.columns) - np.clip(left, 0, grid.columns)
    return float((np.maximum(width, 0.0) * height).sum())
