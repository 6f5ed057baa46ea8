"""Triangles cut into square stamps of samples, the unit of work of the rasteriser."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from focusjax._parallel import in_parallel
from focusjax.layers._boxes import Boxes
from focusjax.layers._clip import ScreenTriangles, edge_functions

SIZES = (1, 2, 4, 8, 16)
"""Edge lengths of stamps in samples; a larger triangle is diced into several of the last size."""

_SAMPLES_AT_ONCE = 1 << 25
"""In the boxes that one call dices, of which one may be larger: a hundred thousand of the largest stamps."""


@dataclasses.dataclass(frozen=True)
class Stamps:
    """Stamps, ordered by size.

    Attributes:
        counts: number of stamps of each of `SIZES`.
        triangle: index [n] into the screen triangles.
        column: of the first sample [n].
        row: of the first sample [n].
    """

    counts: tuple[int, ...]
    triangle: np.ndarray
    column: np.ndarray
    row: np.ndarray


def dice(triangles: ScreenTriangles, boxes: Sequence[Boxes]) -> Stamps:
    """All stamps that may hold a sample of `boxes` whose centre its triangle covers."""

    def some(part: Boxes) -> list[tuple[np.ndarray, ...]]:
        size = _stamp_size(part)
        chosen = ((each, part.take(np.flatnonzero(size == each))) for each in SIZES)
        return [_stamps_of_size(each, triangles, boxes) for each, boxes in chosen]

    # Large triangles are looked at in many stamps before those that they miss are left out.
    work = [less for part in boxes for less in part.portions(part.samples, _SAMPLES_AT_ONCE)]
    # An empty part gives the arrays their types where there are no triangles at all.
    found = in_parallel(some, work) or [some(Boxes(*[np.zeros(0, dtype=np.int32)] * 5))]
    by_size = list(zip(*found, strict=True))
    counts = tuple(sum(len(stamps[0]) for stamps in of_size) for of_size in by_size)
    fields = zip(*(stamps for of_size in by_size for stamps in of_size), strict=True)
    return Stamps(counts, *(np.concatenate(field) for field in fields))


def _tiles(size: int, boxes: Boxes) -> tuple[np.ndarray, np.ndarray]:
    """How many stamps lie side by side in each box, and how many one below the other."""
    shift = size.bit_length() - 1
    return (boxes.width + (size - 1)) >> shift, (boxes.height + (size - 1)) >> shift


def _stamp_size(boxes: Boxes) -> np.ndarray:
    """Smallest stamp of which one covers each box, or up to four if it is larger than two samples."""
    extent = (boxes.width - 1) | (boxes.height - 1)
    size = np.where(extent <= 1, extent + 1, SIZES[-1])
    larger = np.flatnonzero(extent > 1)
    some = boxes.take(larger)
    for each in SIZES[-2:1:-1]:
        across, down = _tiles(each, some)
        size[larger[across * down <= 4]] = each
    return size


def _stamps_of_size(
    size: int, triangles: ScreenTriangles, boxes: Boxes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The arrays of `Stamps`, from `triangle` on, for boxes of one stamp size."""
    triangle, column, row = boxes.triangle, boxes.column, boxes.row
    if size <= 2:
        return triangle, column, row
    across, down = _tiles(size, boxes)
    count = across * down
    owner = np.repeat(np.arange(len(triangle), dtype=np.int32), count)
    tile = np.arange(len(owner), dtype=np.int32) - np.repeat(np.cumsum(count) - count, count)
    tile_row = tile // across[owner]
    right, below = size * (tile - tile_row * across[owner]), size * tile_row
    if size == SIZES[-1]:
        # A stamp wholly outside one side holds nothing: keep those whose best corner is inside all.
        kept = np.ones(len(owner), dtype=bool)
        for x, y, offset, _ in edge_functions(*triangles.around(triangle, column, row), np):
            best = offset + (size - 1) * (np.maximum(x, 0) + np.maximum(y, 0))
            kept &= x[owner] * right + y[owner] * below + best[owner] >= -1e-4
        owner, right, below = (np.compress(kept, a) for a in (owner, right, below))
    return triangle[owner], column[owner] + right.astype(np.int32), row[owner] + below.astype(np.int32)
