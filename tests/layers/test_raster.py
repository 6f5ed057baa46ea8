"""The rasteriser against a brute-force intersection of every ray with every triangle."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from small_scenes import front_camera

from focusjax.geometry import Camera, look_at
from focusjax.layers import Grid
from focusjax.layers._attributes import SurfaceSamples, surface_samples
from focusjax.layers._boxes import boxes_on
from focusjax.layers._clip import ScreenTriangles, clip_to_near
from focusjax.layers._grid import homogeneous_image
from focusjax.layers._raster import SIZES, Fragments, Stamps, dice, rasterise

WIDTH, HEIGHT, NEAR = 40, 28, 0.05
ASIDE = 1e-3
"""Samples; a triangle covers a sample for certain if it covers all places so far aside, too."""


def oblique() -> Camera:
    return look_at(
        (1.0, 0.5, 2.0), (0.3, 0.2, -1.0), (0.1, 1.0, 0.0), width=WIDTH, height=HEIGHT, field_of_view=0.9
    )


def soup() -> tuple[np.ndarray, np.ndarray]:
    """Triangles of every kind [t, 3, 3], and the name of each one's kind [t]."""
    random = np.random.default_rng(5)
    camera = oblique()
    pose = np.asarray(camera.world_from_camera)
    eye = pose[:3, 3]

    def place(count: int) -> np.ndarray:
        depth = random.uniform(0.5, 8.0, (count, 1))
        across = random.uniform(-0.6, 0.6, (count, 2)) * (1.0, 0.7) * depth
        return np.concatenate([across, -depth], axis=1) @ pose[:3, :3].T + eye

    def around(centres: np.ndarray, size: object) -> np.ndarray:
        return centres[:, None] + random.normal(size=(len(centres), 3, 3)) * np.reshape(size, (-1, 1, 1))

    ends = place(30).reshape(-1, 2, 3)
    slivers = np.concatenate(
        [ends, ends.mean(axis=1, keepdims=True) + 1e-3 * random.normal(size=(15, 1, 3))], axis=1
    )
    along = place(20).reshape(-1, 2, 3)
    edge_on = np.concatenate([along, eye + 1.7 * (along[:, :1] - eye)], axis=1)
    points = place(10)
    kinds = {
        "sub-pixel": around(place(60), 0.02),
        "small": around(place(40), np.geomspace(0.05, 0.5, 40)),
        "large": around(place(20), 2.0),
        "huge": around(place(10), 30.0),
        "around the lens": around(np.broadcast_to(eye, (20, 3)), 3.0),
        "sliver": slivers,
        "edge-on": edge_on,
        "degenerate": np.stack([points[:5], points[:5], points[5:]], axis=1),
    }
    kinds["duplicate"] = np.concatenate([kinds["small"][:5], kinds["large"][:3][:, ::-1]])
    names = np.concatenate([np.repeat(name, len(triangles)) for name, triangles in kinds.items()])
    return np.concatenate(list(kinds.values())), names


class Drawn(NamedTuple):
    screen: ScreenTriangles
    grid: Grid
    stamps: Stamps
    fragments: Fragments
    surface: SurfaceSamples


def draw(triangles: np.ndarray, camera: Camera, grid: Grid) -> Drawn:
    vertices, faces = triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)
    screen = clip_to_near(homogeneous_image(vertices, camera, grid), faces, NEAR)
    stamps = dice(screen, boxes_on(grid, screen))
    fragments = rasterise(screen, stamps, grid)
    surface = surface_samples(screen, fragments.sample, fragments.triangle, grid)
    return Drawn(screen, grid, stamps, fragments, surface)


@cache
def drawn_soup() -> Drawn:
    return draw(soup()[0], oblique(), Grid(WIDTH, HEIGHT, 1, 0))


def intersect(triangles: np.ndarray, camera: Camera, shift: tuple[float, float]) -> np.ndarray:
    """Disparity [h * w, t] at which the ray through each shifted pixel centre meets each triangle; 0 if not.

    Moeller and Trumbore, in double precision, with rays a metre deep.
    """
    pose, focal = np.asarray(camera.world_from_camera), float(camera.focal_px)
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 + shift[0], np.arange(HEIGHT) + 0.5 + shift[1])
    local = np.stack([(x - WIDTH / 2) / focal, -(y - HEIGHT / 2) / focal, -np.ones_like(x)], axis=-1)
    directions = local.reshape(-1, 3) @ pose[:3, :3].T
    start, first, second = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    to_eye = pose[:3, 3] - start
    across = np.cross(to_eye, first)
    determinant = directions @ np.cross(second, first).T
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.einsum("tk,tk->t", second, across) / determinant
        u = np.einsum("ntk,tk->nt", np.cross(directions[:, None], second), to_eye) / determinant
        v = directions @ across.T / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth >= NEAR)
        return np.where(hit, 1 / depth, 0.0)


@cache
def truth() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Disparities [n, t] through the centres; where a hit is certain; where it is possible."""
    triangles, camera = soup()[0], oblique()
    # Signs of the closed form: determinant = d . (e2 x e1).
    centre = intersect(triangles, camera, (0.0, 0.0))
    aside = [intersect(triangles, camera, (dx, dy)) > 0 for dx in (-ASIDE, ASIDE) for dy in (-ASIDE, ASIDE)]
    certain = np.logical_and.reduce([centre > 0, *aside])
    return centre, certain, np.logical_or.reduce([centre > 0, *aside])


def test_every_kind_and_size_is_drawn():
    counts = drawn_soup().stamps.counts
    assert all(count > 0 for count in counts), dict(zip(SIZES, counts, strict=True))
    names = soup()[1]
    hit = set(names[truth()[1].any(axis=0)])
    assert hit >= {"sub-pixel", "small", "large", "huge", "around the lens", "duplicate"}


def test_covered_samples_are_those_that_rays_meet():
    drawn, (_, certain, possible) = drawn_soup(), truth()
    count = np.zeros(certain.shape, dtype=int)
    np.add.at(count, (drawn.fragments.sample, drawn.surface.face), 1)
    names = soup()[1]
    missed, made_up = certain & (count == 0), (count > 0) & ~possible
    assert not missed.any(), set(names[missed.any(axis=0)])
    assert not made_up.any(), set(names[made_up.any(axis=0)])
    # A face that the near plane cuts in two pieces may own a sample on the seam twice.
    assert count.max() <= 2
    assert not (count[:, ~np.isin(names, ["huge", "large", "around the lens"])] > 1).any()
    assert not count[:, names == "degenerate"].any()


def test_disparity_and_weights_are_those_of_the_ray():
    drawn, (centre, certain, _) = drawn_soup(), truth()
    sample, face = drawn.fragments.sample, drawn.surface.face
    sure = certain[sample, face]
    expected = centre[sample, face][sure]
    # Observed: 2e-5 relative at worst, on a sliver.
    np.testing.assert_allclose(drawn.fragments.disparity[sure], expected, rtol=1e-4)
    weights = drawn.surface.barycentric
    assert np.isfinite(weights).all()
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-5)
    points = np.einsum("fc,fck->fk", weights, soup()[0][face])
    row, column = np.divmod(sample, WIDTH)
    across, down, depth = homogeneous_image(points, oblique(), drawn.grid).T
    away = np.hypot(across / depth - column - 0.5, down / depth - row - 0.5)
    # Observed: 3e-3 samples at worst.
    assert away[sure].max() < 0.02


def test_slope_is_that_of_the_plane():
    """Disparity is affine on screen, so two samples of one triangle give its slope."""
    drawn, (centre, certain, _) = drawn_soup(), truth()
    sample, face = drawn.fragments.sample, drawn.surface.face
    has_right = (sample % WIDTH < WIDTH - 1) & certain[sample, face]
    has_right &= certain[np.minimum(sample + 1, certain.shape[0] - 1), face]
    step = (centre[np.minimum(sample + 1, len(centre) - 1), face] - centre[sample, face])[has_right]
    tolerance = 1e-3 * np.abs(step) + 1e-5 * centre[sample, face][has_right]
    assert has_right.sum() > 500
    assert (np.abs(drawn.surface.slope_x[has_right] - step) <= tolerance).all()
    has_below = (sample < WIDTH * (HEIGHT - 1)) & certain[sample, face]
    has_below &= certain[np.minimum(sample + WIDTH, certain.shape[0] - 1), face]
    step = (centre[np.minimum(sample + WIDTH, len(centre) - 1), face] - centre[sample, face])[has_below]
    tolerance = 1e-3 * np.abs(step) + 1e-5 * centre[sample, face][has_below]
    assert (np.abs(drawn.surface.slope_y[has_below] - step) <= tolerance).all()


@pytest.mark.parametrize("count", [1, 7, 90])
@pytest.mark.parametrize("angle", [0.0, 0.37, np.pi / 4])
def test_a_tiled_plane_has_no_gaps(count: int, angle: float):
    """Quads cut along random diagonals, tilted, from huge to sub-pixel: all samples covered, few twice."""
    camera = front_camera(WIDTH, HEIGHT)
    random = np.random.default_rng(count)
    line = np.linspace(-3, 3, count + 1)
    inner = random.uniform(-0.3, 0.3, (2, count + 1, count + 1)) * (6 / count)
    inner[:, [0, -1]] = 0
    inner[:, :, [0, -1]] = 0
    u, v = np.array(np.meshgrid(line, line)) + inner
    turned = u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)
    points = np.stack([*turned, -2.0 + 0.3 * turned[0] - 0.2 * turned[1]], axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    flip = random.random((count, count)) < 0.5
    halves = [
        np.where(flip[..., None, None], np.stack(one, axis=-2), np.stack(other, axis=-2))
        for one, other in (((a, b, c), (a, b, d)), ((a, c, d), (b, c, d)))
    ]
    triangles = np.concatenate([half.reshape(-1, 3, 3) for half in halves])
    drawn = draw(triangles, camera, Grid(WIDTH, HEIGHT, 1, 0))
    times = np.bincount(drawn.fragments.sample, minlength=WIDTH * HEIGHT)
    assert times.min() == 1
    # Samples on a seam belong to both sides: here the frame's middle row, column or diagonal.
    assert (times > 1).sum() <= WIDTH + HEIGHT


def test_a_corner_on_sample_centres_leaves_no_gap():
    """Shared sides through sample centres, the case a rasteriser's tie rule is for."""
    camera = front_camera(WIDTH, HEIGHT)
    middle = np.array([20.5, 14.5])
    rim = np.array([(-0.5, -0.5), (40.5, -0.5), (40.5, 28.5), (-0.5, 28.5)])
    xy = np.stack([[middle, rim[i], rim[(i + 1) % 4]] for i in range(4)])
    x, y = np.moveaxis((xy - (20, 14)) / float(camera.focal_px), -1, 0)
    drawn = draw(np.stack([x, -y, -np.ones_like(x)], axis=-1), camera, Grid(WIDTH, HEIGHT, 1, 0))
    times = np.bincount(drawn.fragments.sample, minlength=WIDTH * HEIGHT)
    assert times.min() >= 1
    assert times.max() <= 4


@pytest.mark.parametrize("rounding", [1e-12, 1e-7])
@pytest.mark.parametrize("size", [0.5, 1.0, 20.0])
def test_surfaces_that_meet_on_a_sample_centre_leave_no_gap(size: float, rounding: float):
    """Four surfaces, each with a corner of its own on the centre, which is rounded away from it."""
    camera = front_camera(WIDTH, HEIGHT)
    middle = np.array([20.5, 14.5])
    apex = rounding * np.array([(0, -1), (1, 0), (0, 1), (-1, 0)])
    rim = size * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    xy = middle + np.stack([[apex[i], rim[i], rim[(i + 1) % 4]] for i in range(4)])
    x, y = np.moveaxis((xy - (20, 14)) / float(camera.focal_px), -1, 0)
    drawn = draw(np.stack([x, -y, -np.ones_like(x)], axis=-1), camera, Grid(WIDTH, HEIGHT, 1, 0))
    assert 14 * WIDTH + 20 in drawn.fragments.sample
