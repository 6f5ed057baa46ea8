"""Places are found where they are in the picture, and those that are not there are refused."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import (
    AtInfinity,
    AtPixel,
    AtPoint,
    Blur,
    FocusPoint,
    OnObject,
    OnTriangle,
    Sharp,
    locate,
)
from focusjax.geometry import make_camera

# Two squares facing the camera, 2 m and 4 m ahead; the near one covers the left half of the far one.
NEAR = [[-0.5, -0.3, -2.0], [0.0, -0.3, -2.0], [0.0, 0.3, -2.0], [-0.5, 0.3, -2.0]]
FAR = [[-0.8, -0.4, -4.0], [0.8, -0.4, -4.0], [0.8, 0.4, -4.0], [-0.8, 0.4, -4.0]]
VERTICES = np.array([*NEAR, *FAR])
FACES = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
OBJECTS = {"near": range(2), "far": range(2, 4)}


@pytest.fixture
def camera():
    return make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)


@pytest.fixture
def disparity_map(camera):
    """First surfaces of the two squares, by hand."""
    x, y = np.meshgrid(np.arange(64) + 0.5 - 32, np.arange(48) + 0.5 - 24)
    focal = float(camera.focal_px)
    far = (np.abs(x) < 0.8 * focal / 4) & (np.abs(y) < 0.4 * focal / 4)
    near = (x > -0.5 * focal / 2) & (x < 0) & (np.abs(y) < 0.3 * focal / 2)
    return np.where(near, 0.5, np.where(far, 0.25, 0.0))


def find(where, camera, **scene):
    return locate([FocusPoint(where, Sharp())], camera, **scene)


def test_a_pixel_takes_the_first_surface_at_its_centre(camera, disparity_map):
    # x right, y down: (20.9, 24.1) is in column 20, row 24, on the near square.
    points = find(AtPixel(20.9, 24.1), camera, disparity_map=disparity_map)
    np.testing.assert_allclose(points.xy, [[20.9, 24.1]])
    assert points.disparity.tolist() == [0.5]


def test_a_pixel_on_the_background_is_at_infinity(camera, disparity_map):
    assert find(AtPixel(1, 1), camera, disparity_map=disparity_map).disparity.tolist() == [0.0]


def test_the_frame_includes_its_far_edges(camera, disparity_map):
    assert find(AtPixel(64, 48), camera, disparity_map=disparity_map).xy.tolist() == [[64.0, 48.0]]


def test_a_world_point_is_projected(camera):
    points = find(AtPoint((0.1, 0.2, -4.0)), camera)
    focal = float(camera.focal_px)
    np.testing.assert_allclose(points.xy, [[32 + focal * 0.1 / 4, 24 - focal * 0.2 / 4]])
    assert points.disparity.tolist() == [0.25]


def test_a_direction_is_the_limit_of_points_along_it(camera):
    direction = np.array([0.1, 0.05, -1.0])
    far_away = find(AtPoint(1e9 * direction), camera)
    points = find(AtInfinity(direction), camera)
    np.testing.assert_allclose(points.xy, far_away.xy, rtol=1e-9)
    assert points.disparity.tolist() == [0.0]


def test_a_triangle_point_is_between_its_corners(camera):
    points = find(OnTriangle(2, (0.5, 0.5, 0.0)), camera, vertices=VERTICES, faces=FACES)
    np.testing.assert_allclose(points.xy, find(AtPoint((0.0, -0.4, -4.0)), camera).xy)
    assert points.disparity.tolist() == [0.25]


def test_an_object_is_its_visible_samples_and_they_share_its_weight(camera, disparity_map):
    wishes = [
        FocusPoint(AtPoint((0, 0, -3.0)), Sharp()),
        FocusPoint(OnObject("far", samples=40), Blur(12), weight=3, tolerance=2, name="wall"),
    ]
    points = locate(
        wishes, camera, vertices=VERTICES, faces=FACES, objects=OBJECTS, disparity_map=disparity_map
    )
    assert points.names == ("point 1", "wall")
    assert points.wish.tolist() == [0] + [1] * 40
    np.testing.assert_allclose(points.weight[1:].sum(), 3.0)
    assert set(points.target[1:].tolist()) == {12.0}
    assert set(points.tolerance[1:].tolist()) == {2.0}
    # The near square hides the left half from x = -0.25 m * f / 2 m to the axis.
    hidden = (points.xy[1:, 0] > 32 - 0.5 * camera.focal_px / 2 + 1) & (points.xy[1:, 0] < 31)
    assert not hidden.any()
    np.testing.assert_allclose(points.disparity[1:], 0.25)


def test_object_samples_are_spread_by_area(camera, disparity_map):
    scene = {"vertices": VERTICES, "faces": FACES, "objects": OBJECTS, "disparity_map": disparity_map}
    points = find(OnObject("near", samples=400), camera, **scene)
    focal = float(camera.focal_px)
    middle = np.array([32 - 0.25 * focal / 2, 24.0])
    right, lower = (np.asarray(points.xy) > middle).T
    counts = [quarter.sum() for quarter in (right & lower, right & ~lower, ~right & lower, ~right & ~lower)]
    # A quarter of the square has a quarter of the 400 samples; observed 7 off.
    assert max(abs(count - 100) for count in counts) <= 10


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (AtPixel(64.5, 10), r"focus point 'point 1' is off screen at pixel \(64.5, 10\); expected 0 to 64"),
        (AtPixel(float("nan"), 10), "is off screen"),
        (AtPoint((50.0, 0, -4)), "is outside the frame around pixel .*; move it or the camera"),
        (AtPoint((0, 0, 4.0)), "'point 1' is behind the camera; move it, or turn the camera"),
        (AtPoint((0, 0, 0.0)), "is behind the camera"),
        (AtPoint((0, float("inf"), -1)), "position is .*; expected three finite numbers"),
        (AtInfinity((0, 0, 1.0)), "is behind the camera"),
        (OnTriangle(4, (1, 0, 0)), "is on face 4; the scene has faces 0 to 3"),
        (OnTriangle(0, (1, 1, 0)), "expected three numbers that are not negative and add up to 1"),
        (OnTriangle(0, (1.5, -0.5, 0)), "expected three numbers that are not negative and add up to 1"),
        (OnObject("fra"), "object 'fra', which the scene does not have; did you mean 'far'?"),
        (OnObject("zzz"), r"object 'zzz', which the scene does not have; the scene has \['far', 'near'\]"),
    ],
)
def test_a_place_that_is_not_in_the_picture_is_refused(camera, disparity_map, where, message):
    scene = {"vertices": VERTICES, "faces": FACES, "objects": OBJECTS, "disparity_map": disparity_map}
    with pytest.raises(ValueError, match=message):
        find(where, camera, **scene)


def test_a_hidden_object_is_refused(camera):
    scene = {"vertices": VERTICES, "faces": FACES, "objects": OBJECTS}
    with pytest.raises(ValueError, match=r"focus point 'point 1' is hidden around pixel .*; move the camera"):
        find(OnObject("far"), camera, disparity_map=np.full((48, 64), 0.5), **scene)


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (AtPixel(3, 3), "given as a pixel; that needs the disparity map"),
        (OnTriangle(0, (1, 0, 0)), "is on a mesh; that needs the scene's vertices and faces"),
    ],
)
def test_a_place_that_needs_more_says_so(camera, where, message):
    with pytest.raises(ValueError, match=message):
        find(where, camera)


def test_no_points_are_refused(camera):
    with pytest.raises(ValueError, match="there are no focus points"):
        locate([], camera)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (np.zeros((4, 4)), r"has shape \(4, 4\); expected one value per pixel, \(48, 64\)"),
        (np.full((48, 64), np.nan), "negative values or values that are not finite"),
        (np.full((48, 64), -1.0), "negative values or values that are not finite"),
    ],
)
def test_a_wrong_disparity_map_is_refused(camera, wrong, message):
    with pytest.raises(ValueError, match=message):
        find(AtPixel(3, 3), camera, disparity_map=wrong)
