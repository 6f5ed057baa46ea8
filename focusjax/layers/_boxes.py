"""Boxes of samples around triangles: what a rasteriser may have to look at, known before it does."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

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
        column: of the first sample [b].
        row: of the first sample [b].
        width: number of columns [b].
        height: number of rows [b].
    """

    triangle: np.ndarray
    column: np.ndarray
    row: np.ndarray
    width: np.ndarray
    height: np.ndarray

    @property
    def samples(self) -> Float[np.ndarray, " b"]:
        """How many samples are in each."""
        return self.width.astype(float) * self.height

    def take(self, index: np.ndarray | slice) -> "Boxes":
        """The boxes at the positions `index`."""
        columns = self.triangle, self.column, self.row, self.width, self.height
        return Boxes(*(a[index] for a in columns))

    def within(self, rows: range) -> "Boxes":
        """What of them is in some rows."""
        under = self.row + self.height
        index = np.flatnonzero((self.row < rows.stop) & (under > rows.start))
        triangle, column, top, width, under = (
            np.take(a, index) for a in (self.triangle, self.column, self.row, self.width, under)
        )
        np.maximum(top, np.int32(rows.start), out=top)
        np.minimum(under, np.int32(rows.stop), out=under)
        return Boxes(triangle, column, top, width, under - top)

    def portions(self, cost: Float[np.ndarray, " b"], most: float) -> Iterator["Boxes"]:
        """The same in turns that cost no more than `most`, or are of one box."""
        spent = np.cumsum(cost)
        start = 0
        while start < len(spent):
            before = spent[start - 1] if start else 0.0
            stop = max(start + 1, int(np.searchsorted(spent, before + most, side="right")))
            yield self.take(slice(start, stop))
            start = stop


def joined(boxes: Sequence[Boxes]) -> Boxes:
    """All boxes, one after the other."""
    columns = ((each.triangle, each.column, each.row, each.width, each.height) for each in boxes)
    empty = [np.zeros(0, dtype=np.int32)] * 5
    return Boxes(*(np.concatenate(a) for a in zip(empty, *columns, strict=True)))


def boxes_on(
    grid: Grid,
    triangles: ScreenTriangles,
    *,
    wanted: Bool[np.ndarray, "rows columns"] | None = None,
    first_row: int = 0,
) -> list[Boxes]:
    """Boxes of the samples of `grid` whose centre a triangle may cover.

    If some are `wanted`, those whose square it may touch, of the triangles that may touch a wanted one, in
    the rows of `wanted`, which begin at `first_row`.
    """
    squares = wanted is not None
    before = None if wanted is None else _summed(wanted).ravel()
    rows = first_row, grid.rows if wanted is None else first_row + len(wanted)

    def some(part: slice) -> Boxes:
        left, right = _samples(triangles.span(0, part, quarters=True), (0, grid.columns), squares=squares)
        top, under = _samples(triangles.span(1, part, quarters=True), rows, squares=squares)
        if before is None:
            held = (right > left) & (under > top)
        else:
            first, last = ((row - np.int32(first_row)) * np.int32(grid.columns + 1) for row in (top, under))
            held = np.take(before, last + right) - np.take(before, first + right)
            held = held > np.take(before, last + left) - np.take(before, first + left)
        index = np.flatnonzero(held)
        left, right, top, under = (np.take(a, index) for a in (left, right, top, under))
        return Boxes((part.start + index).astype(np.int32), left, top, right - left, under - top)

    return in_parallel(some, parts(triangles.count, _AT_ONCE))


def _samples(
    span: tuple[np.ndarray, np.ndarray], limits: tuple[int, int], *, squares: bool
) -> tuple[np.ndarray, np.ndarray]:
    """First of the samples in limits whose centre or square intervals [t], in quarters, touch; the end."""
    least, most = span if squares else (span[0] + 1, span[1] - 2)
    first = np.clip(least >> 2, *limits)
    return first, np.clip((most >> 2) + 1, first, limits[1])


def _summed(wanted: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "h+1 w+1"]:
    """How many are wanted in all rows before and all columns before."""
    before = np.zeros((wanted.shape[0] + 1, wanted.shape[1] + 1), dtype=np.int32)
    np.cumsum(wanted, axis=1, dtype=np.int32, out=before[1:, 1:])
    np.cumsum(before, axis=0, out=before)
    return before


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
