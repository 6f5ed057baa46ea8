"""Kyaw's exposure equations, and the lux that traced glass brings."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.film import (
    GREY,
    METER_CONSTANT,
    brightness,
    camera_settings,
    effective_f_number,
    equivalent_time,
    exposure_value,
    f_number_of_area,
    illuminance,
    light_value,
    luminance_of_light_value,
    magnification,
    settings_through,
)
from focusjax.geometry import look_at
from focusjax.lens import prescription_lens, thin_lens, tilt_shift_lens
from focusjax.optics import lens_preset

EXACT = 1e-12
"""Observed 2e-16 to 5e-16 for all identities; 1e-6 is wanted."""


def test_on_the_axis_at_infinity_lux_are_those_of_the_simple_formula():
    # Eq. 4.6 with the luminance in units of 1 / pi cd/m^2; at f/0.5 lux are as many as these.
    assert illuminance(3.0 / jnp.pi, 2.8, transmittance=0.9) == pytest.approx(
        0.9 * 3 / (4 * 2.8**2), rel=EXACT
    )
    assert illuminance(1.0 / jnp.pi, 0.5) == pytest.approx(1.0, rel=EXACT)


def test_lux_go_with_the_inverse_square_of_the_f_number():
    # Eq. 4.7 and 4.8.
    numbers = jnp.array([0.5, 1.0, 1.4, 2.8, 5.6, 22.0])
    lux = illuminance(100.0, numbers)
    np.testing.assert_allclose(lux * numbers**2, jnp.full(6, lux[1]), rtol=EXACT)
    assert lux[2] / lux[3] == pytest.approx((2.8 / 1.4) ** 2, rel=EXACT)


def test_the_general_formula():
    # Eq. 4.9, written out.
    lux = illuminance(
        4000.0, 2.0, magnification=0.5, pupil_magnification=0.8, transmittance=0.9, angle=0.3, passed=0.7
    )
    by_hand = 0.7 * np.pi * 0.9 * 4000 * np.cos(0.3) ** 4 / (4 * 2**2 * (1 + 0.5 / 0.8) ** 2)
    assert lux == pytest.approx(by_hand, rel=EXACT)


def test_exposures_and_times():
    # Eq. 4.10: at one time, H is as the inverse square of N. Eq. 4.11 and 4.12: at one H, E is as 1 / t.
    wide = camera_settings(f_number=2, time=0.01)
    closed = camera_settings(f_number=2.8, time=0.01)
    one = jnp.ones(())
    assert wide.exposure(one) / closed.exposure(one) == pytest.approx(2.8**2 / 2**2, rel=EXACT)
    longer = camera_settings(f_number=2.8, time=equivalent_time(0.01, 2.0, 2.8))
    assert longer.exposure(one) == pytest.approx(float(wide.exposure(one)), rel=EXACT)
    assert wide.illuminance(one) / longer.illuminance(one) == pytest.approx(
        float(longer.time) / 0.01, rel=EXACT
    )
    # Eq. 4.13.
    assert 0.01 / longer.time == pytest.approx(2**2 / 2.8**2, rel=EXACT)


def test_a_stop_down_and_twice_the_time_change_nothing():
    one = jnp.ones(())
    before = camera_settings(f_number=4, time=1 / 60, iso=200, transmittance=0.8)
    after = camera_settings(f_number=4 * np.sqrt(2), time=2 / 60, iso=200, transmittance=0.8)
    assert after.signal(one) == pytest.approx(float(before.signal(one)), rel=EXACT)
    assert after.exposure_value() == pytest.approx(
        float(before.exposure_value()), abs=1e-12
    )  # observed 4e-16


def test_effective_apertures():
    # Eq. 4.3 to 4.5: v / e, of a 50 mm lens with a pupil of 25 mm, focused on 0.3 m.
    image_distance = 1 / (1 / 0.05 - 1 / 0.3)
    m = magnification(0.05, 1 / 0.3)
    assert m == pytest.approx(image_distance / 0.3, rel=EXACT)
    assert effective_f_number(2.0, m) == pytest.approx(image_distance / 0.025, rel=EXACT)
    assert magnification(0.05, 0.0) == 0.0
    assert f_number_of_area(0.05, np.pi * 0.0125**2) == pytest.approx(2.0, rel=EXACT)


def test_light_values_are_those_of_meters():
    # ISO 2720: settings whose N^2 / t is L S / K read the luminance L rightly.
    settings = camera_settings(f_number=8, time=1 / 125, iso=400)
    luminance = METER_CONSTANT * 8**2 * 125 / 400
    assert settings.exposure_value() == pytest.approx(float(light_value(luminance)), rel=EXACT)
    assert exposure_value(1.0, 1.0) == 0.0
    # They expose it as 0.177 of white: the meter's constant and the ISO speed's differ by 0.03 stops.
    assert settings.signal(jnp.asarray(luminance)) == pytest.approx(GREY, rel=0.02)  # observed 1.8 %
    assert light_value(GREY * luminance_of_light_value(12.0)) == pytest.approx(12.0, rel=EXACT)


def test_white_light_is_as_bright_as_its_channels():
    assert brightness(jnp.ones((2, 3, 3))) == pytest.approx(np.ones((2, 3)), rel=EXACT)


@pytest.mark.parametrize("distance", [np.inf, 0.6])
def test_lux_through_glass_are_those_of_the_formula(distance):
    """Film on the axis of a double Gauss, of a scene of 1 cd/m^2: light from all over the last surface."""
    camera = look_at((0, 0, 1), (0, 0, 0), width=60, height=40, focal_length=0.05)
    lens = prescription_lens(
        lens_preset("gauss_jp62087922_f1.8_1987"),
        camera,
        focus_distance=distance,
        f_number=4,
        focus="paraxial",
    )
    # The integral of cos^4 over the opening, over the film's distance squared.
    lux = np.pi * float(lens.exposure) / float(lens.film_place) ** 2
    settings = settings_through(lens, camera, time=1, iso=100)
    # Observed 0.03 % and 0.07 % off: the formula has the aperture of first-order optics.
    assert settings.illuminance(jnp.ones(())) == pytest.approx(lux, rel=0.02)
    assert (float(settings.magnification) > 0.05) == (distance < 1)


def test_settings_of_ideal_lenses():
    camera = look_at((0, 0, 1), (0, 0, 0), width=60, height=40, focal_length=0.1)
    thin = thin_lens(focus_distance=0.2, f_number=2, focal_length=0.1)
    settings = settings_through(thin, camera, time=0.5, iso=50)
    # Life size: two stops are lost.
    assert settings.magnification == pytest.approx(1.0)
    assert settings.effective_f_number() == pytest.approx(4.0)
    tilted = tilt_shift_lens(focus_distance=np.inf, tilt=0.1, f_number=2, focal_length=0.1)
    assert settings_through(tilted, camera, time=0.5).magnification == 0.0


def test_derivatives_are_those_of_differences():
    def lux(values):
        return illuminance(100.0, values[0], magnification=values[1], angle=values[2], passed=values[3])

    at, step = jnp.array([2.8, 0.3, 0.4, 0.8]), 1e-6
    differences = [(lux(at.at[i].add(step)) - lux(at.at[i].add(-step))) / (2 * step) for i in range(4)]
    np.testing.assert_allclose(jax.grad(lux)(at), differences, rtol=1e-7)  # observed 2e-9


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"time": 0}, "shutter time is 0 s; expected a positive, finite time such as 1/60"),
        ({"time": np.inf}, "shutter time is inf s; expected a positive, finite time"),
        ({"time": -1}, "shutter time is -1 s"),
        ({"iso": 0.5}, "ISO speed is 0.5; expected from 1 to 10000000"),
        ({"iso": 2e7}, "ISO speed is 2e"),
        ({"iso": np.nan}, "ISO speed is nan"),
        ({"f_number": 0.4}, "f-number is 0.4; expected a number from 0.5 on"),
        ({"f_number": np.inf}, "f-number is inf"),
        ({"transmittance": 0}, "transmittance is 0; expected above 0"),
        ({"transmittance": 1.1}, "transmittance is 1.1"),
        ({"magnification": -0.1}, "magnification is -0.1; expected 0 or more"),
        ({"pupil_magnification": 0}, "pupil magnification is 0"),
    ],
)
def test_settings_that_no_camera_has_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        camera_settings(**({"f_number": 2.8, "time": 0.01} | given))


def test_lenses_that_expose_nothing_are_refused():
    camera = look_at((0, 0, 1), (0, 0, 0), width=60, height=40, focal_length=0.1)
    with pytest.raises(ValueError, match="the lens is a pinhole, which has no f-number"):
        settings_through(thin_lens(focus_distance=1, aperture_radius=0), camera, time=1)
    with pytest.raises(
        ValueError, match=r"focused 0.05 m away, within its focal length 0.1 m; focus farther"
    ):
        settings_through(thin_lens(focus_distance=0.05, aperture_radius=0.02), camera, time=1)
