"""Squares and the triangles that touch them: the same however many are looked at at a time."""

import numpy as np
import pytest

from focusjax import _parallel
from focusjax.layers import Grid, _touching
from focusjax.layers._boxes import Boxes
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._touching import OFFSETS, Band, Touching, in_bands, touching

GRID = Grid(50, 37, 1, 0)


def soup(count: int, seed: int) -> ScreenTriangles:
    """Triangles of all sizes at all depths, some of them beyond the grid."""
    random = np.random.default_rng(seed)
    size = np.geomspace(0.2, 60, count)[:, None, None]
    places = random.uniform(-6, 56, (count, 1, 2)) + size * random.normal(size=(count, 3, 2))
    points = np.concatenate([places, random.uniform(0.1, 1.0, (count, 3, 1))], axis=2).reshape(-1, 3)
    faces = np.arange(3 * count).reshape(-1, 3)
    return ScreenTriangles(points, faces, np.arange(count), count, np.zeros((0, 3, 3)))


def squares(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells, in order and some of them several times, and the disparities that count in each."""
    random = np.random.default_rng(seed)
    cell = np.sort(random.integers(0, GRID.size, 900))
    low = random.uniform(0, 0.9, len(cell))
    return cell, low, low + random.uniform(0, 0.3, len(cell))


def pairs(found: Touching) -> dict[tuple[int, int], tuple[int, bool]]:
    """Points and whether the centre is covered, by square and triangle."""
    columns = found.square, found.triangle, found.points, found.centre
    rows = [(int(s), int(t), int(p), bool(c)) for s, t, p, c in zip(*columns, strict=True)]
    assert len({row[:2] for row in rows}) == len(rows)
    return {row[:2]: row[2:] for row in rows}


def looked_at(triangles: ScreenTriangles) -> tuple[dict[tuple[int, int], tuple[int, bool]], int]:
    """All pairs, and in how many bands they were found."""
    cell, low, high = squares(5)

    def look(band: Band) -> dict[tuple[int, int], tuple[int, bool]]:
        mine = band.squares
        found = pairs(touching(band, triangles, GRID, cell[mine], low[mine], high[mine]))
        return {(square + mine.start, triangle): rest for (square, triangle), rest in found.items()}

    bands = in_bands(look, triangles, GRID, cell)
    together = {key: value for band in bands for key, value in band.items()}
    assert len(together) == sum(len(band) for band in bands)
    return together, len(bands)


def test_pairs_are_those_of_every_square_with_every_triangle():
    triangles = soup(150, seed=3)
    cell, low, high = squares(5)
    found, _ = looked_at(triangles)
    corners = triangles.corners
    row, column = np.divmod(cell, GRID.columns)
    unsure = 0
    for number in range(len(corners)):
        x, y, w = corners[number].T
        inverse = np.linalg.inv(np.stack([x, y, np.ones(3)]))
        centre = np.stack([column + 0.5, row + 0.5, np.ones(len(cell))])
        at_centre = (inverse @ centre).min(axis=0)
        there = w @ (inverse @ centre)
        meant = np.clip(there, w.min(), w.max())
        meant = (meant >= low) & (meant <= high)
        inside = np.stack(
            [(inverse @ (centre + np.array([[dx], [dy], [0.0]]))).min(axis=0) for dx, dy in OFFSETS]
        )
        for square in np.flatnonzero(meant):
            bits = sum(1 << k for k in np.flatnonzero(inside[:, square] >= 0))
            got, covers = found.get((int(square), number), (0, False))
            if abs(at_centre[square]) > 1e-4:
                assert covers == (at_centre[square] > 0)
            # A point on an edge to within rounding may count or not.
            close = sum(1 << k for k in np.flatnonzero(np.abs(inside[:, square]) < 1e-4))
            assert (got ^ bits) & ~close == 0
            unsure += got != bits
        for square in np.flatnonzero(~meant):
            assert (int(square), number) not in found
    # Observed: 0.
    assert unsure <= 3
    assert len(found) > 400


@pytest.mark.parametrize("grid_at_once", [1 << 22, 200])
def test_the_number_of_bands_changes_nothing(monkeypatch: pytest.MonkeyPatch, grid_at_once: int):
    triangles = soup(120, seed=4)
    whole, few = looked_at(triangles)
    monkeypatch.setattr(_touching, "_GRID_AT_ONCE", grid_at_once)
    monkeypatch.setattr(_touching, "_LEAST_AT_ONCE", 40)
    monkeypatch.setattr(_parallel, "CORES", 7)
    banded, many = looked_at(triangles)
    assert few == 1
    assert many > 6
    assert banded == whole


def test_no_squares_are_no_bands():
    assert in_bands(lambda band: band, soup(5, seed=1), GRID, np.zeros(0, dtype=int)) == []


def test_boxes_within_rows_are_cut_to_them():
    boxes = Boxes(
        *(np.array(a, dtype=np.int32) for a in ([0, 1, 2], [3, 4, 5], [0, 8, 20], [2, 2, 2], [9, 8, 4]))
    )
    found = boxes.within(range(8, 16))
    assert found.triangle.tolist() == [0, 1]
    assert found.row.tolist() == [8, 8]
    assert found.height.tolist() == [1, 8]
    # What they were made of is as it was.
    assert boxes.row.tolist() == [0, 8, 20]
