"""Where a camera looks, what it projects to, and what it refuses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients

from focusjax.geometry import FULL_FRAME_WIDTH, Camera, look_at, make_camera

FRAME = {"width": 40, "height": 30, "field_of_view": 0.9}


def oblique() -> Camera:
    """A pose aligned with nothing."""
    return look_at((1.0, -2.0, 3.0), (0.2, 0.5, -4.0), (0.1, 1.0, 0.2), **FRAME)


def random_points(count: int) -> np.ndarray:
    """World points [count, 3] ahead of and behind the oblique camera, none near its lens plane."""
    pose = np.asarray(oblique().world_from_camera)
    points = np.random.default_rng(1).uniform(-30, 30, (count, 3))
    return points[np.abs((points - pose[:3, 3]) @ pose[:3, 2]) > 0.5]


@pytest.mark.parametrize(
    ("target", "up", "right", "down"),
    [
        pytest.param((0, 0, -1), (0, 1, 0), (1, 0, 0), (0, -1, 0), id="along -z"),
        pytest.param((0, 0, 5), (0, 1, 0), (-1, 0, 0), (0, -1, 0), id="along +z"),
        pytest.param((3, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0), id="along +x"),
        pytest.param((0, -2, 0), (0, 0, -1), (1, 0, 0), (0, 0, 1), id="straight down"),
        pytest.param((0, 0, -1), (1, 0, 0), (0, -1, 0), (-1, 0, 0), id="on its side"),
    ],
)
def test_x_runs_right_and_y_down(target, up, right, down):
    camera = look_at((0.0, 0.0, 0.0), target, up, **FRAME)
    ahead = np.array(target) / np.linalg.norm(target) * 4.0
    for point, axis in ((ahead, None), (ahead + np.array(right), 0), (ahead + np.array(down), 1)):
        xy, disparity = camera.project(jnp.array(point, dtype=float))
        expected = np.array([20.0, 15.0])
        if axis is not None:
            expected[axis] += float(camera.focal_px) / 4.0
        np.testing.assert_allclose(xy, expected, atol=1e-12)
        assert float(disparity) == pytest.approx(0.25)


def test_pixel_centres_are_at_half_integers():
    camera = look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), **{**FRAME, "width": 3, "height": 5})
    np.testing.assert_array_equal(camera.direction(jnp.array([1.5, 2.5])), [0.0, 0.0, -1.0])


def test_pose_is_a_rotation_towards_the_target():
    camera = oblique()
    rotation = np.asarray(camera.world_from_camera[:3, :3])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_array_equal(camera.position, [1.0, -2.0, 3.0])
    xy, _ = camera.project(jnp.array([0.2, 0.5, -4.0]))
    np.testing.assert_allclose(xy, [20.0, 15.0], atol=1e-12)
    above, _ = camera.project(jnp.array([0.2, 0.5, -4.0]) + 0.1 * jnp.array([0.1, 1.0, 0.2]))
    np.testing.assert_allclose(above[0], 20.0, atol=1e-12)
    assert above[1] < 15.0


def test_field_of_view_spans_the_width():
    camera = look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), **FRAME)
    edge, _ = camera.project(jnp.array([np.sin(0.45), 0.0, -np.cos(0.45)]))
    np.testing.assert_allclose(edge, [40.0, 15.0], atol=1e-12)
    assert float(camera.sensor_width) == FULL_FRAME_WIDTH


def test_focal_length_in_pixels():
    camera = make_camera(np.eye(4), width=720, height=480, focal_length=0.05, sensor_width=0.036)
    assert float(camera.focal_px) == pytest.approx(1000.0)


def test_unproject_undoes_project():
    camera = oblique()
    points = random_points(200)
    xy, disparity = jax.jit(jax.vmap(camera.project))(jnp.array(points))
    depth = (np.asarray(camera.position) - points) @ np.asarray(camera.world_from_camera)[:3, 2]
    assert min((depth < 0).sum(), (depth > 0).sum()) > 50
    np.testing.assert_allclose(disparity, 1.0 / depth)
    np.testing.assert_allclose(jax.jit(jax.vmap(camera.unproject))(xy, disparity), points, atol=1e-12)


def test_points_behind_have_negative_disparity_and_the_lens_plane_none():
    camera = look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), **FRAME)
    _, behind = camera.project(jnp.array([0.3, 0.2, 2.0]))
    assert float(behind) == -0.5
    xy, beside = camera.project(jnp.array([0.3, 0.2, 0.0]))
    assert np.isinf(np.asarray(beside))
    assert np.isinf(np.asarray(xy)).all()


@pytest.mark.parametrize("point", [(0.5, 0.1, -2.0), (0.0, 0.5, -40.0)])
def test_gradients_match_differences(point):
    # Observed: 5e-9 of the largest.
    check_gradients(there_and_back, oblique(), jnp.array(point))


def there_and_back(camera, point):
    xy, disparity = camera.project(point)
    return xy, disparity, camera.unproject(xy + 1.0, 2.0 * disparity)


def test_a_camera_is_a_pytree_of_its_numbers():
    assert [leaf.shape for leaf in jax.tree.leaves(oblique())] == [(4, 4), (), (), (2,)]


def _tilted(value: float, row: int, column: int) -> np.ndarray:
    pose = np.eye(4)
    pose[row, column] = value
    return pose


@pytest.mark.parametrize(
    ("pose", "changes", "message"),
    [
        (np.eye(3), {}, r"the camera matrix has shape \(3, 3\); expected 4 rows of 4 numbers"),
        (_tilted(np.nan, 0, 3), {}, "the camera matrix has a value that is not finite; expected a pose"),
        (_tilted(2.0, 1, 1), {}, "3 x 3 part is not a rotation; remove scale, shear or mirroring"),
        (_tilted(-1.0, 2, 2), {}, "3 x 3 part is not a rotation; remove scale, shear or mirroring"),
        (_tilted(0.3, 0, 1), {}, "3 x 3 part is not a rotation; remove scale, shear or mirroring"),
        (np.eye(4), {"width": 0}, "width is 0 pixels; expected at least 1"),
        (np.eye(4), {"height": -3}, "height is -3 pixels; expected at least 1"),
        (np.eye(4), {"sensor_width": 0.0}, r"sensor width is 0\.0 m; expected a positive length"),
        (np.eye(4), {"field_of_view": None}, "give exactly one of focal length and field of view"),
        (np.eye(4), {"focal_length": 0.05}, "give exactly one of focal length and field of view"),
        (np.eye(4), {"field_of_view": 3.5}, r"field of view is 3\.5 rad; expected between 0 and pi"),
        (np.eye(4), {"field_of_view": np.nan}, "field of view is nan rad; expected between 0 and pi"),
        (
            np.eye(4),
            {"field_of_view": None, "focal_length": -0.1},
            r"focal length is -0\.1 m; expected a positive length",
        ),
        (
            np.eye(4),
            {"field_of_view": None, "focal_length": np.nan},
            "focal length is nan m; expected a positive length",
        ),
        (
            np.eye(4),
            {"field_of_view": None, "focal_length": np.inf},
            "focal length is inf m; expected a positive length",
        ),
    ],
)
def test_bad_cameras_are_refused(pose, changes, message):
    with pytest.raises(ValueError, match=message):
        make_camera(pose, **{**FRAME, **changes})


@pytest.mark.parametrize(
    ("target", "up", "message"),
    [
        ((1.0, 2.0, 3.0), (0.0, 1.0, 0.0), "the camera looks at its own position .*; move one of the two"),
        ((1.0, 0.0, 3.0), (0.0, 1.0, 0.0), "up .* is along the view axis; choose another up direction"),
        ((1.0, 2.0, 0.0), (0.0, 0.0, 0.0), "up .* is along the view axis; choose another up direction"),
        ((np.nan, 2.0, 0.0), (0.0, 1.0, 0.0), "not finite|own position"),
    ],
)
def test_look_at_refuses_what_has_no_direction(target, up, message):
    with pytest.raises(ValueError, match=message):
        look_at((1.0, 2.0, 3.0), target, up, **FRAME)
