"""Neighbouring samples of one surface are joined, those of two are not."""

import numpy as np
import pytest

from focusjax.layers import NEIGHBOURS, SAME_LAYER, UNJOINED
from focusjax.layers._joins import Planes, join

PARALLAX = 100.0
"""Samples per dioptre: a step of 0.01 is one sample."""


def joined(disparity: object, slope_x: object = 0.0, slope_y: object = 0.0) -> tuple[np.ndarray, ...]:
    """Extents [l, h, w] and the code [l, h, w] of every neighbour (dx, dy)."""
    disparity = np.asarray(disparity, dtype=np.float64)
    slopes = (np.array(np.broadcast_to(s, disparity.shape), dtype=np.float64) for s in (slope_x, slope_y))
    held = np.flatnonzero(disparity)
    columns = (a.reshape(-1)[held] for a in (disparity, *slopes))
    joins = join(Planes(disparity.shape, held, *columns), PARALLAX)

    def whole(samples: np.ndarray) -> np.ndarray:
        out = np.zeros(disparity.size, dtype=samples.dtype)
        out[held] = samples
        return out.reshape(disparity.shape)

    codes = {
        step: whole((joins.links >> np.uint32(4 * k)) & np.uint32(15)) for k, step in enumerate(NEIGHBOURS)
    }
    return whole(joins.low), whole(joins.high), codes


def grid(rows: int = 6, columns: int = 8) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[:rows, :columns].astype(float)
    return x, y


def has_neighbour(shape: tuple[int, int], dx: int, dy: int) -> np.ndarray:
    x, y = grid(*shape)
    return (x + dx >= 0) & (x + dx < shape[1]) & (y + dy >= 0) & (y + dy < shape[0])


@pytest.mark.parametrize(
    ("gx", "gy"), [(0.05, 0.0), (-0.05, 0.02), (0.07, 0.07), (0.001, -0.002), (0.0, 0.0)]
)
def test_a_plane_is_joined_however_steep(gx: float, gy: float):
    x, y = grid()
    w = 1.0 + gx * x + gy * y
    low, high, codes = joined(w[None], gx, gy)
    for (dx, dy), code in codes.items():
        inside = has_neighbour(w.shape, dx, dy)
        assert (code[0][inside] == SAME_LAYER).all()
        assert (code[0][~inside] == UNJOINED).all()
    # Half-way to the farthest of the eight neighbours, so that samples that touch share disparities.
    half = (abs(gx) + abs(gy)) / 2
    inner = (slice(1, -1), slice(1, -1))
    np.testing.assert_allclose(low[0][inner], (w - half)[inner])
    np.testing.assert_allclose(high[0][inner], (w + half)[inner])
    # At the open border half a sample of the plane remains, but never more than half a small step.
    assert (low <= w).all()
    assert (high >= w).all()


def test_silhouettes_stay_open():
    w = np.where(grid()[0] < 4, 1.0, 0.2)
    low, high, codes = joined(w[None])
    edge = grid()[0] == 3
    for (dx, _), code in codes.items():
        assert (code[0][edge] == UNJOINED)[1:-1].reshape(-1).all() == (dx == 1)
    np.testing.assert_array_equal(low[0], w)
    np.testing.assert_array_equal(high[0], w)


def test_a_step_that_no_ray_can_tell_is_joined():
    """Within one sample of parallax, whatever the planes say; beyond it, only if they agree."""
    for step, is_joined in ((0.009, True), (0.011, False)):
        w = np.where(grid()[0] < 4, 1.0, 1.0 + step)
        _, _, codes = joined(w[None])
        assert (codes[1, 0][0][:, 3] == (SAME_LAYER if is_joined else UNJOINED)).all()


def test_a_plane_that_the_neighbour_does_not_continue_is_not_joined():
    """The left half is steep and heads for the right half's disparity; the right half faces the camera."""
    x, _ = grid()
    gx = np.where(x < 4, 0.1, 0.0)
    w = np.where(x < 4, 1.0 + 0.1 * x, 1.4)
    _, _, codes = joined(w[None], gx)
    assert (codes[1, 0][0][:, 3] == UNJOINED).all()
    assert (codes[-1, 0][0][:, 4] == UNJOINED).all()


def test_holes_join_nothing():
    w = np.ones((5, 5))
    w[2, 2] = 0.0
    low, high, codes = joined(w[None])
    assert low[0, 2, 2] == high[0, 2, 2] == 0
    for (dx, dy), code in codes.items():
        assert code[0, 2, 2] == UNJOINED
        assert code[0, 2 - dy, 2 - dx] == UNJOINED


@pytest.mark.parametrize("layer", [1, 2])
def test_a_surface_is_followed_into_the_layer_it_changes_to(layer: int):
    """A steep plane that passes under `layer` other surfaces in the right half."""
    x, y = grid()
    plane = 0.5 + 0.04 * x + 0.03 * y
    under = x >= 4
    w, gx, gy = (np.zeros((3, *x.shape)) for _ in range(3))
    for k in range(layer):
        w[k][under] = 2.0 - 0.3 * k
    w[0][~under] = plane[~under]
    w[layer][under] = plane[under]
    flat = (w > 1.5) | (w == 2.0 - 0.3)
    gx[~flat], gy[~flat] = 0.04, 0.03
    low, high, codes = joined(w, gx, gy)
    middle = slice(1, -1)
    for dy in (-1, 0, 1):
        assert (codes[1, dy][0, middle, 3] == SAME_LAYER + layer).all()
        assert (codes[-1, dy][layer, middle, 4] == SAME_LAYER - layer).all()
        assert (codes[-1, dy][0, middle, 4] == UNJOINED).all()
    np.testing.assert_allclose(high[0, middle, 3], plane[middle, 3] + 0.035)
    np.testing.assert_allclose(low[layer, middle, 4], plane[middle, 4] - 0.035)


def test_the_plane_that_fits_best_is_joined_whichever_layer_it_is_in():
    """A twig pushes a wall down a layer, next to a backdrop so close behind that no ray could show it."""
    x, _ = grid()
    twig = x == 4
    w = np.stack([np.where(twig, 1.5, 1.0), np.where(twig, 1.0, 0.992), np.where(twig, 0.992, 0.0)])
    _, _, codes = joined(w)
    for dy in (-1, 0, 1):
        for dx in (-1, 1):
            assert (codes[dx, dy][1, 1:-1, 4] == SAME_LAYER - 1).all()
            assert (codes[dx, dy][2, 1:-1, 4] == SAME_LAYER - 1).all()
            assert (codes[dx, dy][0, 1:-1, 4] == UNJOINED).all()
        for layer in (0, 1):
            assert (codes[1, dy][layer, 1:-1, 3] == SAME_LAYER + 1).all()
            assert (codes[-1, dy][layer, 1:-1, 5] == SAME_LAYER + 1).all()
