"""Wishes of every kind become the rows they should, and those that cannot be seen do not count."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import (
    AT_LEAST,
    AT_MOST,
    EQUAL,
    SAME,
    AtInfinity,
    AtLeast,
    AtMost,
    AtPixel,
    AtPoint,
    Blur,
    FocusPoint,
    InDepthRange,
    OfHeight,
    OnMask,
    OnSensor,
    SameBlur,
    Sharp,
    errors,
    locate,
)
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens


@pytest.fixture
def camera():
    return make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05, sensor_width=0.032)


@pytest.fixture
def wall():
    """A wall 4 m away whose left half a screen 2 m away covers."""
    return np.where(np.arange(64) < 32, 0.5, 0.25) * np.ones((48, 1))


def test_units_of_blur(camera):
    wishes = [
        FocusPoint(AtPoint((0, 0, -2)), Blur(OnSensor(0.25)), tolerance=OnSensor(0.05)),
        FocusPoint(AtPoint((0, 0, -2)), AtMost(OfHeight(0.125)), tolerance=OfHeight(0.01)),
        FocusPoint(AtPoint((0, 0, -2)), AtLeast(3.0)),
        FocusPoint(AtPoint((0, 0, -2)), Blur(OnSensor(-0.25), signed=True)),
    ]
    points = locate(wishes, camera)
    # 0.5 mm of the sensor are a pixel.
    np.testing.assert_allclose(points.target, [0.5, 6.0, 3.0, -0.5], rtol=1e-12)
    np.testing.assert_allclose(points.tolerance, [0.1, 0.48, 1.0, 1.0], rtol=1e-12)
    assert points.relation.tolist() == [EQUAL, AT_MOST, AT_LEAST, EQUAL]
    assert points.signed.tolist() == [False, False, False, True]


def test_limits_have_errors_on_their_wrong_side_only(camera):
    lens = thin_lens(focus_distance=2.0, f_number=1.0, focal_length=0.05)
    wishes = [FocusPoint(AtPoint((0, 0, -4)), kind(size)) for kind in (AtMost, AtLeast) for size in (1, 2)]
    # Blur at 4 m: 2 * 100 px * 0.025 m * 0.25 / m.
    blur = 1.25
    np.testing.assert_allclose(errors(locate(wishes, camera), camera, lens), [blur - 1, 0, 0, blur - 2])


def test_the_same_blur_is_that_of_the_other_point(camera):
    lens = thin_lens(focus_distance=2.0, f_number=1.0, focal_length=0.05)
    wishes = [
        FocusPoint(AtPoint((0, 0, -1)), SameBlur("range")),
        FocusPoint(AtPoint((0, 0, -1)), SameBlur("range", same_side=True)),
        FocusPoint(InDepthRange(4.0, np.inf, samples=5), Blur(1), name="range"),
    ]
    points = locate(wishes, camera)
    assert points.relation.tolist() == [SAME, SAME] + [EQUAL] * 5
    # Blur is -2.5 px at 1 m, and 1.25 to 2.5 px over the range.
    np.testing.assert_allclose(errors(points, camera, lens)[:2], [2.5 - 1.875, -2.5 - 1.875])


@pytest.mark.parametrize(
    ("other", "message"),
    [("fce", "does not exist; did you mean 'face'?"), ("hat", "is to be as blurred as itself")],
)
def test_the_same_blur_needs_another_point(camera, other, message):
    wishes = [
        FocusPoint(AtPoint((0, 0, -1)), Sharp(), name="face"),
        FocusPoint(AtPoint((0, 0, -1)), SameBlur(other), name="hat"),
    ]
    with pytest.raises(ValueError, match=message):
        locate(wishes, camera)


def test_a_depth_range_is_even_in_disparity(camera):
    points = locate([FocusPoint(InDepthRange(2.0, np.inf, samples=3), Sharp(), weight=6)], camera)
    np.testing.assert_allclose(points.disparity, [0.5, 0.25, 0.0])
    np.testing.assert_allclose(points.weight, 2.0)


def test_a_mask_is_the_surface_under_it(camera, wall):
    mask = np.zeros((48, 64), bool)
    mask[10:20, 28:36] = True
    points = locate([FocusPoint(OnMask(mask, samples=16), Sharp())], camera, disparity_map=wall)
    columns, lines = np.asarray(points.xy).T
    assert columns.min() > 28
    assert columns.max() < 36
    assert lines.min() > 10
    assert lines.max() < 20
    # Half of the mask is on the screen, and so is half of the samples.
    assert points.disparity.tolist().count(0.5) == 8


@pytest.mark.parametrize(
    ("mask", "message"),
    [(np.ones((4, 4), bool), "mask of shape"), (np.zeros((48, 64), bool), "has an empty mask")],
)
def test_a_wrong_mask_is_refused(camera, wall, mask, message):
    with pytest.raises(ValueError, match=message):
        locate([FocusPoint(OnMask(mask), Sharp())], camera, disparity_map=wall)


def test_what_is_outside_the_frame_is_ignored_unless_asked_otherwise(camera):
    inside = FocusPoint(AtPoint((0, 0, -2)), Sharp())
    for place, note in (
        (AtPoint((5, 0, -2)), "outside the frame"),
        (AtPoint((0, 0, 2)), "behind the camera"),
    ):
        points = locate([inside, FocusPoint(place, Sharp())], camera)
        assert points.weight.tolist() == [1.0, 0.0]
        assert points.notes == ("", note)
    kept = locate([inside, FocusPoint(AtPoint((5, 0, -2)), Sharp(), even_outside=True)], camera)
    assert kept.weight.tolist() == [1.0, 1.0]
    assert kept.notes == ("", "counts although outside the frame")


def test_influence_fades_as_a_point_becomes_hidden(camera, wall):
    # A point on the wall passes behind the screen, from right to left.
    across = np.linspace(35.0, 29.0, 61)
    places = [AtPoint(((x - 32) / 100 * 4, 0, -4)) for x in across]
    near = FocusPoint(AtPixel(3, 3), Sharp())
    weight = [
        float(locate([near, FocusPoint(place, Sharp())], camera, disparity_map=wall).weight[1])
        for place in places
    ]
    assert weight[0] == 1.0
    assert weight[-1] == 0.0
    # Monotonous, with no jump; observed 0.075 at most over a tenth of a pixel.
    assert np.all(np.diff(weight) <= 1e-12)
    assert -np.diff(weight).min() < 0.1
    hidden = FocusPoint(places[-1], Sharp(), even_hidden=True)
    assert locate([near, hidden], camera, disparity_map=wall).weight.tolist() == [1.0, 1.0]


def test_a_grazing_surface_does_not_hide_itself(camera):
    # The table 0.3 m below the camera, at whose far end disparity changes by a tenth per pixel.
    line = np.maximum(np.arange(48) + 0.5 - 24, 0.0)
    table = np.tile((line / 100 / 0.3)[:, None], 64)
    points = locate([FocusPoint(AtPoint((0, -0.3, -3.1)), Sharp())], camera, disparity_map=table)
    assert float(points.weight[0]) > 0.99


def test_a_star_behind_a_wall_is_hidden(camera, wall):
    wishes = [FocusPoint(AtPixel(3, 3), Sharp()), FocusPoint(AtInfinity((0, 0, -1)), Sharp())]
    assert locate(wishes, camera, disparity_map=wall).notes == ("", "hidden")
    assert locate(wishes, camera, disparity_map=0.0 * wall).notes == ("", "")


def test_near_wishes_may_count_more(camera):
    wishes = [FocusPoint(AtPoint((0, 0, -z)), Sharp()) for z in (1, 2)] + [
        FocusPoint(AtInfinity((0, 0, -1)), Sharp())
    ]
    np.testing.assert_allclose(locate(wishes, camera, favour_near=1.0).weight, [2.0, 1.5, 1.0])
