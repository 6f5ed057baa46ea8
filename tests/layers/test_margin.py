"""The margin: as wide as rays leave the frame and find something, and no wider."""

import numpy as np
import pytest
from small_scenes import HEIGHT, WIDTH, front_camera, patch, wide_lens

from focusjax.layers import Grid, peel
from focusjax.layers._clip import ScreenTriangles, clip_to_near
from focusjax.layers._frame import needed_margin, reachable
from focusjax.layers._grid import homogeneous_image
from focusjax.scene import constant_background, make_scene
from focusjax.trace import render

FRAME = Grid(WIDTH, HEIGHT, 1, 0)


def reach(disparity: np.ndarray) -> np.ndarray:
    """A lens that moves rays by 10 pixels per dioptre, focused at half a dioptre."""
    return 10.0 * np.abs(disparity - 0.5) + 2.0


def on_screen(corners: object) -> ScreenTriangles:
    corners = np.asarray(corners, dtype=np.float64)
    count = len(corners)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    source = np.arange(count, dtype=np.int32)
    return ScreenTriangles(corners.reshape(-1, 3), faces, source, count, np.zeros((0, 3, 3)))


def small(x: float, y: float, disparity: float) -> list[tuple[float, float, float]]:
    return [(x, y, disparity), (x + 0.1, y, disparity), (x, y + 0.1, disparity)]


@pytest.mark.parametrize(
    ("x", "y", "disparity", "reached"),
    [
        pytest.param(10.0, 10.0, 0.5, True, id="inside"),
        pytest.param(-1.5, 10.0, 0.5, True, id="just outside, in focus"),
        pytest.param(-3.0, 10.0, 0.5, False, id="farther outside, in focus"),
        pytest.param(-6.0, 10.0, 0.0, True, id="far behind the focus"),
        pytest.param(-8.0, 10.0, 0.0, False, id="too far out for infinity"),
        pytest.param(WIDTH + 10.0, 10.0, 1.5, True, id="right, in front"),
        pytest.param(WIDTH + 13.0, 10.0, 1.5, False, id="right, too far"),
        pytest.param(10.0, HEIGHT + 11.0, 1.5, True, id="below"),
        pytest.param(10.0, -11.0, 1.5, True, id="above"),
    ],
)
def test_reachable(x: float, y: float, disparity: float, reached: bool):
    triangles = on_screen([small(x, y, disparity)])
    assert reachable(triangles, FRAME, reach)[0] == reached
    outside = max(-x, x - WIDTH, -y, y - HEIGHT, 0.0)
    margin = needed_margin(triangles, FRAME, reach)
    # A sample more for where splitting stops, and the triangle's own size.
    assert outside * reached <= margin <= outside * reached + 1.2


def test_no_triangles_need_no_margin():
    assert needed_margin(on_screen(np.zeros((0, 3, 3))), FRAME, reach) <= 1.0


def test_margin_of_random_triangles_matches_dense_points():
    random = np.random.default_rng(0)
    share = random.dirichlet((0.5, 0.5, 0.5), 20000)
    for _ in range(12):
        corners = random.uniform((-60, -60, 0.01), (WIDTH + 60, HEIGHT + 60, 4.0), (1, 3, 3))
        x, y, w = np.moveaxis(share @ corners[0], -1, 0)
        outside = np.maximum.reduce([-x, x - WIDTH, -y, y - HEIGHT, np.zeros_like(x)])
        dense = np.where(outside <= reach(w), outside, 0.0).max()
        margin = needed_margin(on_screen(corners), FRAME, reach)
        # Splitting stops within a sample, and the points leave gaps of about one.
        assert dense <= margin <= dense + 2.5


def test_a_ground_plane_under_the_camera_needs_little():
    """Where it is next to the lens, blur has thousands of pixels, but the frame is farther away still."""
    camera = front_camera()
    ground = np.array([(-50, -1.0, 50), (50, -1.0, 50), (50, -1.0, -50), (-50, -1.0, -50)], dtype=float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    triangles = clip_to_near(homogeneous_image(ground, camera, FRAME), faces, 1e-3)
    assert reach(triangles.corners[..., 2]).max() > 5000
    # A point of the ground at disparity w is 40 w pixels below the middle, 40 w - 12 below the frame, and
    # moved by 10 |w - 1/2| + 2: they meet 3.2 below it. To the sides it is the far ground, blurred by
    # up to 7.
    assert needed_margin(triangles, FRAME, reach) < 8.0


def test_what_blur_brings_into_the_frame_is_there():
    """Lamps just outside all four sides, out of focus, light the frame's border as the formula says."""
    camera = front_camera()
    boxes = [(-4, 8, -2, 16), (34, 8, 36, 16), (12, -4, 20, -2), (12, 26, 20, 28)]
    lamps = [patch(f"lamp {k}", camera, box, 1.0, 50.0) for k, box in enumerate(boxes)]
    lens = wide_lens(camera)
    layers = peel(make_scene(lamps, background=constant_background(0.0), unlit=True), camera, lens)
    assert layers.grid.margin / layers.grid.supersampling >= 4
    picture = np.asarray(render(layers, lens, rays=256))[..., 0]
    radius = 6.0
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    expected, middles = np.zeros((HEIGHT, WIDTH)), (np.arange(30) + 0.5) / 30
    for left, top, right, bottom in boxes:
        across, down = left + (right - left) * middles, top + (bottom - top) * middles
        for a, b in np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2):
            expected += ((x - a) ** 2 + (y - b) ** 2 <= radius**2) / middles.size**2
    expected *= 50.0 * 16 / (np.pi * radius**2)
    for side in (np.s_[:, :4], np.s_[:, -4:], np.s_[:4], np.s_[-4:]):
        assert expected[side].max() > 3
        # Observed: 0.026 at worst.
        assert picture[side].sum() == pytest.approx(expected[side].sum(), rel=0.05)
    # Means of 4 x 4 pixels, 1024 rays each.
    error = (picture - expected).reshape(HEIGHT // 4, 4, WIDTH // 4, 4).mean(axis=(1, 3))
    # Observed: 0.18
    assert np.abs(error).max() < 0.4
