"""Boxes around triangles, and the area that they bound, against closed forms."""

import numpy as np
import pytest

from focusjax.layers import Grid, _raster
from focusjax.layers._boxes import boxes_on, covered_area
from focusjax.layers._clip import ScreenTriangles

GRID = Grid(60, 40, 1, 0)


def on_screen(*triangles: list[tuple[float, float]]) -> ScreenTriangles:
    """Triangles given by their corners on the grid."""
    points = np.concatenate([np.concatenate(triangles), np.ones((3 * len(triangles), 1))], axis=1)
    faces = np.arange(len(points)).reshape(-1, 3)
    return ScreenTriangles(points, faces, np.arange(len(faces)), len(faces), np.zeros((0, 3, 3)))


@pytest.mark.parametrize(
    ("corners", "area"),
    [
        ([(10, 10), (30, 10), (10, 30)], 200.0),
        ([(30, 10), (10, 10), (10, 30)], 200.0),
        ([(-20, 0), (20, 0), (-20, 40)], 200.0),
        ([(-1000, -1000), (1000, -1000), (0, 1000)], 2400.0),
        # Only the corner of the grid lies on the near side of x + y = 20.
        ([(-500, 520), (520, -500), (-500, -500)], 200.0),
        ([(0, 0), (60, 40), (60, 40.1)], 3.0),
        ([(5, 5), (20, 5), (50, 5)], 0.0),
        ([(70, 0), (90, 0), (70, 40)], 0.0),
    ],
)
def test_the_area_that_is_on_the_grid(corners, area):
    triangles = on_screen(corners)
    found = covered_area(GRID, triangles, boxes_on(GRID, triangles))
    # Observed: 0 but for the needle, which ends beyond the grid, 0.0075.
    assert found == pytest.approx(area, abs=0.02)


def test_triangles_in_turns_make_the_same_stamps(monkeypatch: pytest.MonkeyPatch):
    random = np.random.default_rng(2)
    middle, size = random.uniform(-5, 60, (300, 1, 2)), np.geomspace(0.3, 50, 300)[:, None, None]
    triangles = on_screen(*(middle + size * random.normal(size=(300, 3, 2))))
    boxes = boxes_on(GRID, triangles)
    together = _raster.dice(triangles, boxes)
    monkeypatch.setattr(_raster, "_DICED_AT_ONCE", 500)
    turns = list(boxes[0].portions(boxes[0].samples, 500))
    assert len(turns) > 50
    assert all(turn.samples.sum() <= 500 or len(turn.triangle) == 1 for turn in turns)
    apart = _raster.dice(triangles, boxes)
    assert together.counts == apart.counts
    for name in ("triangle", "column", "row"):
        np.testing.assert_array_equal(getattr(together, name), getattr(apart, name))


def test_no_triangles_make_no_stamps():
    triangles = on_screen([(70, 0), (90, 0), (70, 40)])
    assert sum(_raster.dice(triangles, boxes_on(GRID, triangles)).counts) == 0
    assert sum(_raster.dice(triangles.take(np.zeros(0, dtype=int)), []).counts) == 0
