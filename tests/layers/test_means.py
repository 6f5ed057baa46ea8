"""A sample's radiance is the mean over the part of its square that its surface covers."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.geometry import make_camera
from focusjax.layers import Layers, peel, radiance_slopes
from focusjax.lens import thin_lens
from focusjax.scene import constant_background, make_object, make_scene
from focusjax.trace import render

WIDTH, HEIGHT, DEPTH = 40, 30, 2.0
CAMERA = make_camera(np.eye(4), width=WIDTH, height=HEIGHT, field_of_view=0.6)
FOCAL = float(CAMERA.focal_px)
LENS = thin_lens(focus_distance=DEPTH, aperture_radius=0.05)
FINE = 32


def placed(corners: np.ndarray, disparity: np.ndarray | float = 1.0 / DEPTH) -> np.ndarray:
    """World places of `corners` [v, 2] in pixels at a disparity each."""
    depth = 1.0 / np.broadcast_to(disparity, len(corners))
    x, y = ((corners - np.asarray(CAMERA.principal_point)) / FOCAL * depth[:, None]).T
    return np.stack([x, -y, -depth], axis=1)


def peeled(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray) -> Layers:
    shape = make_object("shape", vertices, faces, vertex_colours=colours)
    scene = make_scene([shape], background=constant_background(np.zeros(3)), unlit=True)
    return peel(scene, CAMERA, LENS, supersampling=1)


def inner(layers: Layers) -> np.ndarray:
    """Radiance of the first layer at the pixels of the frame."""
    margin = layers.grid.margin
    return np.asarray(layers.radiance)[0, margin : margin + HEIGHT, margin : margin + WIDTH]


def checkers(edge: float, turn: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A wall of squares `edge` pixels wide, as a mesh; and its exact mean over each pixel."""
    across = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    middle, count = np.array([20.3, 15.2]), int(2 * 60 / edge)
    row, column = np.mgrid[:count, :count].reshape(2, -1) - count // 2
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    corners = (np.stack([column, row], axis=1)[:, None] + corner).reshape(-1, 2) * edge
    first = 4 * np.arange(len(row))[:, None]
    faces = (first[:, None] + np.array([(0, 1, 2), (0, 2, 3)])).reshape(-1, 3)
    colours = np.repeat(np.where((row + column) % 2 == 0, 0.9, 0.1), 4)[:, None] * np.ones(3)
    y, x = (np.mgrid[: HEIGHT * FINE, : WIDTH * FINE] + 0.5) / FINE
    square = np.floor((np.stack([x, y], axis=-1) - middle) @ across.T / edge)
    exact = np.where(square.sum(axis=-1) % 2 == 0, 0.9, 0.1)
    exact = exact.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3))
    return placed(corners @ across + middle), faces, colours, exact


@pytest.mark.parametrize("edge", [6.37, 2.3, 0.61])
@pytest.mark.parametrize("turn", [0.0, 0.37])
def test_colour_edges_that_cut_samples(edge: float, turn: float):
    vertices, faces, colours, exact = checkers(edge, turn)
    error = inner(peeled(vertices, faces, colours))[..., 0] - exact
    # Observed: at most 0.11 in one sample, 0.034 in the root mean square and 6e-4 in the mean, of colours 0.8
    # apart, with squares smaller than a sample; 0.073, 0.011 and 5e-4 with the largest. These are the 32
    # points'; the colour at the centre is 0.4 off along edges.
    assert np.abs(error).max() < 0.13
    assert np.sqrt((error**2).mean()) < 0.04
    assert abs(error.mean()) < 0.001


def test_triangles_smaller_than_a_sample_keep_their_mean():
    generator = np.random.default_rng(3)
    count = np.array([60, 80])
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in count[::-1])), axis=-1).astype(float)
    grid[1:-1, 1:-1] += generator.uniform(-0.3, 0.3, grid[1:-1, 1:-1].shape)
    index = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    a, b, c, d = (
        index[i : i + count[0], j : j + count[1]].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    # Each triangle of one colour.
    corners = (grid.reshape(-1, 2) / 2.0)[faces].reshape(-1, 2)
    colour = generator.uniform(0, 1, len(faces))
    alone = np.arange(3 * len(faces)).reshape(-1, 3)
    found = inner(peeled(placed(corners), alone, np.repeat(colour, 3)[:, None] * np.ones(3)))[..., 0]
    first, second = (corners[alone[:, k]] - corners[alone[:, 0]] for k in (1, 2))
    area = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    # Observed: 1.5e-4 apart; looked at in the centres of samples, as a draw of 1200 is, 0.008.
    assert abs(found.mean() - (area * colour).sum() / area.sum()) < 1e-3


def test_surfaces_that_cross_within_a_square():
    """Two upright panes cross in the middle of a column of samples: each is before the other for a half."""
    corners = np.array([(10.5, -5.0), (30.5, -5.0), (30.5, 35.0), (10.5, 35.0)])
    tilt = np.array([1, -1, -1, 1]) * 1e-3
    vertices = np.concatenate([placed(corners, 1 / DEPTH + tilt), placed(corners, 1 / DEPTH - tilt)])
    colours = np.repeat([0.2, 0.8], 4)[:, None] * np.ones(3)
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    found = inner(peeled(vertices, faces, colours))[:, :, 0]
    assert np.allclose(found[:, 12:20], 0.2, atol=1e-5)
    assert np.allclose(found[:, 21:29], 0.8, atol=1e-5)
    assert np.allclose(found[:, 20], 0.5, atol=1e-5)


def test_a_picture_in_focus_is_the_mean_over_pixels():
    vertices, faces, colours, exact = checkers(2.3, 0.37)
    layers = peeled(vertices, faces, colours)
    picture = np.asarray(render(layers, LENS, rays=64, even=True))[..., 0]
    # Observed: 0.0195 in the root mean square, that of the 32 points.
    assert np.sqrt(((picture - exact) ** 2).mean()) < 0.025


def test_slopes_follow_a_ramp_and_leave_no_darkness_below_none():
    corners = np.array([(-20.0, -20.0), (60.0, -20.0), (60.0, 50.0), (-20.0, 50.0)])
    ramp = (corners @ [0.004, 0.002] + 0.2)[:, None] * np.ones(3)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    layers = peeled(placed(corners), faces, ramp)
    held = np.asarray(layers.samples.links) == 0x88888888
    across, down = (np.stack(slope)[:, held] for slope in radiance_slopes(layers))
    assert np.allclose(across, 0.004, atol=1e-5)
    assert np.allclose(down, 0.002, atol=1e-5)
    vertices, faces, colours, _ = checkers(3.4, 0.37)
    layers = peeled(vertices, faces, np.where(colours > 0.5, 50.0, 0.0))
    across, down = (jnp.stack(slope, axis=-1) for slope in radiance_slopes(layers))
    lowest = layers.samples.radiance - 0.5 * (jnp.abs(across) + jnp.abs(down))
    assert float(lowest.min()) > -1e-4
