"""When the light arrives: curves, rolling shutters, and what is no shutter."""

import re

import numpy as np
import pytest

from focusjax.shutter import make_shutter

SHARES = np.linspace(0.0, 1.0, 257)


def test_a_box_lets_light_in_evenly():
    shutter = make_shutter(0.02)
    np.testing.assert_allclose(shutter.quantiles(), 0.02 * (SHARES - 0.5), atol=1e-15)
    assert shutter.interval() == (-0.01, 0.01)
    assert make_shutter(0.02, align="start").interval() == (0.0, 0.02)
    assert make_shutter(0.02, align="end").interval() == (-0.02, 0.0)


def test_a_shutter_that_opens_slowly_is_open_for_longer_for_the_same_light():
    triangle = make_shutter(1.0, ramp=1.0)
    assert triangle.open_time == pytest.approx(2.0)
    # The light of a triangle of base 2 has grown to t^2 / 2 after a time t, and the other half in mirror
    # image. Observed 4e-6 off.
    half = np.sqrt(2 * SHARES[:129]) - 1.0
    np.testing.assert_allclose(triangle.quantiles()[:129], half, atol=2e-5)
    np.testing.assert_allclose(triangle.quantiles(), -triangle.quantiles()[::-1], atol=1e-12)
    trapezoid = make_shutter(1.0, ramp=0.25)
    # Its curve is a table of 257 places; observed 1.2e-5 off.
    assert trapezoid.open_time == pytest.approx(1.25, rel=1e-4)
    ramp = 0.25
    np.testing.assert_allclose(
        np.interp(ramp / 2, SHARES, trapezoid.quantiles()) - trapezoid.begin, ramp, atol=1e-4
    )


def test_a_curve_is_given_by_numbers_of_any_scale():
    triangle, given = make_shutter(0.5, ramp=1.0), make_shutter(0.5, curve=[0, 7, 0])
    np.testing.assert_allclose(given.quantiles(), triangle.quantiles(), atol=1e-12)
    # Closed for a third of the time in between: no light then.
    twice = make_shutter(1.0, curve=[1, 1, 0, 0, 1, 1]).quantiles()
    assert not ((twice > -0.1) & (twice < 0.1)).any()


def test_a_rolling_shutter_takes_longer_for_the_whole_picture():
    shutter = make_shutter(0.01, travel_time=0.02, direction="up")
    assert shutter.interval() == pytest.approx((-0.015, 0.015))
    assert shutter.delay == -0.02


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"time": 0.0},
            "the shutter time is 0.0 s; expected a positive, finite number of seconds such as 0.02, or no",
        ),
        ({"time": np.inf}, "the shutter time is inf s; expected a positive, finite number"),
        (
            {"time": 1, "travel_time": -1},
            "the shutter's travel time is -1 s; expected 0 or a positive number",
        ),
        ({"time": 1, "ramp": 1.5}, "the shutter's ramp is 1.5; expected a share of its time from 0 to 1"),
        ({"time": 1, "ramp": 0.1, "curve": [1, 1]}, "has a ramp and a curve; give one or the other"),
        (
            {"time": 1, "curve": [0, 0]},
            "the shutter's curve is [0, 0]; expected two or more numbers of 0 or above",
        ),
        (
            {"time": 1, "align": "rear"},
            "the shutter's align is 'rear'; expected one of 'centre', 'start', 'end'",
        ),
    ],
)
def test_what_is_no_shutter_is_reported(arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        make_shutter(**arguments)
