"""Cutting triangles along the near plane."""

import numpy as np
import pytest

from focusjax.layers._clip import ScreenTriangles, clip_to_near

NEAR = 0.5


def homogeneous(points: object) -> np.ndarray:
    """(x z, y z, z) of camera-like points (x, y, depth): already linear in space, so any numbers will do."""
    return np.asarray(points, dtype=np.float64)


def clip(points: object) -> ScreenTriangles:
    points = homogeneous(points)
    return clip_to_near(points, np.arange(len(points)).reshape(-1, 3), NEAR)


def weights_of(clipped: ScreenTriangles) -> np.ndarray:
    """Barycentric weights [t, 3 corners, 3] of all corners, those of whole faces too."""
    return np.concatenate([np.broadcast_to(np.eye(3), (clipped.unclipped, 3, 3)), clipped.weights])


def shares(clipped: ScreenTriangles) -> np.ndarray:
    """Area [t] of each piece relative to its face."""
    return np.abs(np.linalg.det(weights_of(clipped)))


def random_triangles(count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform((-3, -3, NEAR - 3), (3, 3, NEAR + 3), (3 * count, 3))


def test_pieces_add_up_to_what_is_in_front():
    points = random_triangles(300)
    clipped = clip(points)
    area = np.bincount(clipped.source, shares(clipped), minlength=300)
    for face, corners in enumerate(points.reshape(-1, 3, 3)):
        ahead = corners[:, 2] - NEAR
        # With one corner on its own side, the triangle it cuts off has the product of two edge shares.
        alone = {1: ahead > 0, 2: ahead < 0}.get(int((ahead > 0).sum()))
        expected = float((ahead > 0).all())
        if alone is not None:
            (tip,), others = ahead[alone], ahead[~alone]
            cut_off = np.prod(tip / (tip - others))
            expected = cut_off if tip > 0 else 1 - cut_off
        assert area[face] == pytest.approx(expected, abs=1e-12)


def test_weights_give_the_corners_back():
    points = random_triangles(300)
    clipped = clip(points)
    mixed = np.einsum("tcf,tfk->tck", weights_of(clipped), points.reshape(-1, 3, 3)[clipped.source])
    z = mixed[..., 2:]
    assert z.min() >= NEAR - 1e-12
    expected = np.concatenate([mixed[..., :2] / z, 1 / z], axis=-1)
    np.testing.assert_allclose(clipped.corners, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(weights_of(clipped).sum(axis=-1), 1.0)
    assert weights_of(clipped).min() >= 0


def test_whole_faces_come_first_and_in_order():
    clipped = clip(random_triangles(100))
    whole = clipped.source[: clipped.unclipped]
    assert (np.diff(whole) > 0).all()
    assert 0 < clipped.unclipped < len(clipped.source) == clipped.unclipped + len(clipped.weights)


@pytest.mark.parametrize(
    ("depths", "pieces", "share"),
    [
        pytest.param((1.0, 2.0, 3.0), 1, 1.0, id="ahead"),
        pytest.param((-1.0, 0.2, 0.4), 0, 0.0, id="behind"),
        pytest.param((1.5, -0.5, -0.5), 1, 0.25, id="one corner ahead"),
        pytest.param((-0.5, 1.5, 1.5), 2, 0.75, id="two corners ahead"),
        pytest.param((0.0, 1.0, 1.0), 2, 0.75, id="a corner in the lens plane"),
        pytest.param((0.0, 0.0, 1.0), 1, 0.25, id="a side in the lens plane"),
        pytest.param((0.0, 0.0, 0.0), 0, 0.0, id="in the lens plane"),
        pytest.param((NEAR, 1.0, 1.0), 1, 1.0, id="a corner on the near plane, from ahead"),
        pytest.param((NEAR, NEAR, 1.0), 1, 1.0, id="a side on the near plane"),
        pytest.param((NEAR, 0.0, 0.0), 1, 0.0, id="a corner on the near plane, from behind"),
    ],
)
@pytest.mark.parametrize("turn", [0, 1, 2])
def test_cases(depths, pieces, share, turn):
    depths = np.roll(depths, turn)
    clipped = clip(np.column_stack([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], depths]))
    assert len(clipped.source) == pieces
    assert shares(clipped).sum() == pytest.approx(share, abs=1e-12)
    assert np.isfinite(clipped.corners).all()
    assert (clipped.corners[..., 2] <= 1 / NEAR + 1e-12).all()


def test_vertices_are_linear_in_what_they_carry():
    """A function that is affine in space, carried by the weights, has its own value at every new corner."""
    points = random_triangles(200)
    clipped = clip(points)
    value = points @ np.array([0.3, -1.2, 0.7]) + 2.0
    carried = np.einsum("tcf,tf->tc", weights_of(clipped), value.reshape(-1, 3)[clipped.source])
    z = 1 / clipped.corners[..., 2:]
    place = np.concatenate([clipped.corners[..., :2] * z, z], axis=-1)
    np.testing.assert_allclose(carried, place @ np.array([0.3, -1.2, 0.7]) + 2.0, atol=1e-9)


def test_take_keeps_whole_and_cut_faces_apart():
    clipped = clip(random_triangles(100))
    index = np.arange(1, len(clipped.source), 3)
    taken = clipped.take(index)
    np.testing.assert_array_equal(taken.corners, clipped.corners[index])
    np.testing.assert_array_equal(taken.source, clipped.source[index])
    np.testing.assert_array_equal(weights_of(taken), weights_of(clipped)[index])
