"""Response curves, films, sensors, grain and noise."""

import dataclasses
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients
from scipy.stats import poisson

from focusjax.film import (
    GREY,
    SATURATION,
    Film,
    Sensor,
    camera_settings,
    develop,
    encode_srgb,
    film,
    film_exposure,
    film_names,
    film_preset,
    load_curve,
    photograph,
    response_curve,
    sensor,
)

NAMES = ("plain", "filmic", "negative", "reversal", "black_and_white")
EMULSIONS = NAMES[2:]


COUNT = 161
"""Pixels of a picture that is developed: a film's program is one for them all."""


def ramp(least: float, most: float) -> jnp.ndarray:
    """Greys [1, n, 3] over so many decades around a metered grey."""
    values = GREY * 10.0 ** jnp.linspace(least, most, COUNT)
    return jnp.broadcast_to(values[None, :, None], (1, COUNT, 3))


def test_presets_are_those_that_are_named():
    assert film_names() == NAMES
    with pytest.raises(ValueError, match="there is no film 'reversed'; did you mean 'reversal'"):
        film_preset("reversed")
    with pytest.raises(ValueError, match="plain is a sensor, which has no grain"):
        film_preset("plain", rms_granularity=8)


@pytest.mark.parametrize("name", NAMES)
def test_a_metered_grey_stays_grey_and_more_light_is_never_darker_and_never_beyond_white(name):
    picture = np.asarray(develop(ramp(-8, 8), film_preset(name)))[0]
    # Observed: 2e-4 off, the digits of the tables, of which the slide's goes through the grey by its formula.
    np.testing.assert_allclose(picture[COUNT // 2], GREY, rtol=4e-4)
    shown = picture[:, 0]
    assert (np.diff(shown) >= -1e-12).all()
    assert (shown >= 0).all()
    assert shown[-1] == pytest.approx(SATURATION if name == "plain" else 1.0, rel=1e-4)


@pytest.mark.parametrize("name", EMULSIONS)
def test_twice_the_time_is_a_stop_everywhere_on_the_straight_part(name):
    """Of density, by the film's slope; and hardly anything in toe and shoulder."""
    medium = film_preset(name)
    places = {"negative": (-0.6, 0.9), "reversal": (-0.7, -0.35), "black_and_white": (-0.6, 0.5)}[name]
    logs = jnp.linspace(*places, 9)
    signal = jnp.broadcast_to(GREY * 10.0 ** logs[None, :, None], (1, 9, 3))
    density = eqx.filter_jit(lambda film, signal: film.density(signal))
    step = np.asarray(density(medium, 2 * signal) - density(medium, signal))
    slope = {"negative": 0.6, "reversal": -1.7, "black_and_white": 0.62}[name]
    # Observed within 0.9 %: what is left of toe and shoulder.
    np.testing.assert_allclose(step, np.full(step.shape, slope * np.log10(2)), rtol=0.015)
    ends = jnp.broadcast_to(GREY * 10.0 ** jnp.linspace(-2.5, 3.0, 9)[None, :, None], (1, 9, 3))
    step = np.asarray(density(medium, 2 * ends) - density(medium, ends))[0, :, 0]
    assert np.abs(step[[0, -1]]).max() < 0.05 * abs(slope)


def test_a_sensor_is_straight_until_it_is_full():
    image = jnp.full((2, 2, 3), 0.3)
    settings = camera_settings(f_number=2.8, time=1 / 60, iso=100)
    level = 0.2 / float(settings.signal(jnp.ones(())) * 0.3)
    shown = [
        float(
            photograph(image, camera_settings(f_number=2.8, time=n / 60, iso=100), luminance=level)[0, 0, 0]
        )
        for n in (1, 2, 4, 8)
    ]
    np.testing.assert_allclose(shown, [0.2, 0.4, 0.8, SATURATION], rtol=1e-12)  # observed 2e-16


def test_lux_seconds_of_a_uniform_scene():
    settings = camera_settings(f_number=4, time=0.02, iso=400, transmittance=0.9)
    exposure = film_exposure(jnp.full((2, 3, 3), 0.5), settings, luminance=2000.0)
    np.testing.assert_allclose(exposure, jnp.full((2, 3, 3), np.pi / 4 * 0.9 * 1000 / 16 * 0.02), rtol=1e-12)
    # ISO 12232: a grey takes 10 / S lux seconds.
    shown = photograph(jnp.full((2, 3, 3), 0.5), settings, luminance=2000.0 * 10 / 400 / exposure[0, 0, 0])
    np.testing.assert_allclose(shown, jnp.full((2, 3, 3), GREY), rtol=1e-12)  # observed 2e-16


def test_the_filmic_curve_is_hables():
    """Between the points of its table, too."""
    c = np.geomspace(0.003, 11.2, 57)

    def f(x):
        return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3

    # The signal that is shown as a grey of 0.18 is 0.18: the gain follows from that.
    gains = np.linspace(1, 6, 100001)
    gain = gains[np.argmin(np.abs(f(gains * GREY) / f(11.2) - GREY))]
    signal = jnp.asarray(np.broadcast_to((c / gain)[None, :, None], (1, 57, 3)))
    shown = np.asarray(develop(signal, film_preset("filmic")))[0, :, 0]
    np.testing.assert_allclose(shown, f(c) / f(11.2), rtol=2e-3)  # observed 4e-4


@eqx.filter_jit
def light_and_slope(image, settings, medium):
    def mean(light):
        return jnp.mean(photograph(light, settings, medium, luminance=1e5, seed=0))

    return jax.value_and_grad(mean)(image)


@pytest.mark.parametrize("name", ["plain", "filmic", "negative"])
def test_bright_lights_do_not_overflow_in_single_precision(name):
    """A million times as bright as their neighbours, and far too long exposed."""
    image = jnp.array([[[1e6, 1.0, 1e-6], [0.0, 0.0, 0.0]]], dtype=jnp.float32)
    medium = sensor(full_well=1000) if name == "plain" else film_preset(name, rms_granularity=8)
    settings = camera_settings(f_number=1, time=30, iso=1e6)
    settings, medium = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), (settings, medium))
    shown, slope = light_and_slope(image, settings, medium)
    assert shown.dtype == jnp.float32
    assert np.isfinite(float(shown))
    assert np.isfinite(np.asarray(slope)).all()


def test_black_and_white_film_sees_no_colour():
    image = jnp.full((1, COUNT, 3), 0.1).at[0, :2].set([[0.3, 0.1, 0.05], [0.05, 0.1, 0.3]])
    shown = np.asarray(develop(image, film_preset("black_and_white")))[:, :2]
    assert np.ptp(shown, axis=-1) == pytest.approx(0.0, abs=1e-12)
    assert shown[0, 0, 0] > shown[0, 1, 0]


def test_a_slide_has_more_contrast_than_a_print_and_less_latitude():
    steep, plain = (
        np.diff(np.log10(np.asarray(develop(ramp(-0.3, 0.3), film_preset(name)))[0, :: COUNT // 2, 0]))
        for name in ("reversal", "plain")
    )
    assert (steep > 1.3 * plain).all()


def test_grain_follows_selwyn_and_nutting():
    """Its deviation is the RMS granularity at density 1, falls with a pixel's side, and is seeded."""
    curve = response_curve([-1.0, 0.0, 1.0], [0.0, 1.0, 2.0])
    medium = film(curve, rms_granularity=20)
    grey = jnp.full((128, 128, 3), GREY)
    side = np.sqrt(np.pi) * 24e-6
    density = [-np.log10(develop(grey, medium, sensor_width=128 * side * n, seed=1)) for n in (1.0, 2.0)]
    # Net density 1 over a pixel as large as the measuring spot; observed 0.4 % off, of 49152 values.
    assert np.std(density[0]) == pytest.approx(0.020, rel=0.02)
    assert np.std(density[1]) == pytest.approx(0.010, rel=0.02)
    darker = -np.log10(develop(grey / 2, medium, sensor_width=128 * side, seed=1))
    assert np.std(darker) == pytest.approx(0.020 * np.sqrt(1 - np.log10(2)), rel=0.02)
    again = -np.log10(develop(grey, medium, sensor_width=128 * side, seed=1))
    np.testing.assert_array_equal(again, density[0])
    assert np.ptp(develop(grey, medium, sensor_width=128 * side)) == 0.0


def test_noise_is_that_of_photons_and_of_reading():
    medium = sensor(full_well=1000, read_noise=20, base_iso=200)
    signal = jnp.full((128, 128, 3), 0.7)
    for iso in (200.0, 800.0):
        electrons = 0.7 / SATURATION * 1000 * 200 / iso
        noisy = develop(signal, medium, iso=iso, seed=2)
        relative = float(jnp.std(noisy) / jnp.mean(noisy))
        # Observed 0.5 % off.
        assert relative == pytest.approx(np.sqrt(electrons + 20**2) / electrons, rel=0.02)
    assert float(jnp.mean(noisy)) == pytest.approx(0.7, rel=0.01)


def test_few_photons_are_counted_by_poissons_law():
    """Against scipy's, number by number; pixels without light count none."""
    medium = sensor(full_well=1000 * SATURATION)
    counts = np.asarray(develop(jnp.full((128, 128, 3), 0.003), medium, seed=5)) * 1000
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    found = np.bincount(np.round(counts).astype(int).ravel(), minlength=12)[:12] / counts.size
    # Observed: 0.003, of 49152 pixels.
    np.testing.assert_allclose(found, poisson.pmf(np.arange(12), 3.0), atol=0.008)
    assert not np.asarray(develop(jnp.zeros((8, 8, 3)), medium, seed=5)).any()


@pytest.mark.parametrize("name", ["plain", "negative"])
def test_derivatives_of_the_developed_picture(name):
    """By f-number, time, speed, radiance and white balance, with grain or noise as it is."""
    medium = film_preset(name)
    if isinstance(medium, Film):
        medium = film(medium.curve, paper=medium.paper, rms_granularity=8)
    else:
        medium = sensor(full_well=3000, read_noise=4)
    image = jnp.linspace(0.05, 1.0, 24).reshape(2, 4, 3)

    def shown(factors):
        settings = camera_settings(f_number=4, time=1 / 100, iso=200)
        settings = dataclasses.replace(
            settings,
            f_number=settings.f_number * factors[0],
            time=settings.time * factors[1],
            iso=settings.iso * factors[2],
        )
        balance = jnp.ones(3).at[0].set(factors[4])
        picture = photograph(image * factors[3], settings, medium, luminance=500.0, balance=balance, seed=3)
        return encode_srgb(picture)

    slopes = check_gradients(shown, jnp.array([1.0, 1.0, 1.0, 1.0, 1.1]))
    # Light is light: by time, and by half as many f-numbers; without noise, by speed as well.
    np.testing.assert_allclose(slopes[:, 0], -2 * slopes[:, 1], atol=1e-12)


def test_curves_that_turn_are_refused_by_the_point_where_they_do(tmp_path):
    message = (
        "the response curve rises from end to end, but in red it falls from density 0.9 at log exposure 0 to"
        " 0.8 at 1 (point 3); a response has to be monotonic"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        response_curve([-1, 0, 1, 2], [0.1, 0.9, 0.8, 1.5])
    path = tmp_path / "film.csv"
    path.write_text("# source: none\nlog_exposure,red,green,blue\n-1,2,2,2\n0,1,1,1\n1,0.5,0.5,1.2\n")
    with pytest.raises(
        ValueError, match=r"film.csv falls from end to end, but in blue it rises .* .point 3."
    ):
        load_curve(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the first line is missing; expected log_exposure,density"),
        ("x,y\n1,2\n", "the first line is x,y; expected"),
        ("log_exposure,density\n0,0\n1\n", "point 2 is 1; expected 2 numbers"),
        ("log_exposure,density\n0,0\n1,much\n", "point 2 is 1,much; expected 2 numbers"),
        (
            "log_exposure,density\n0,0\n0,1\n",
            "from log exposure 0 to 0 at point 2; log exposures have to rise",
        ),
        ("log_exposure,density\n0,0\n", "with two points or more"),
        ("log_exposure,density\n0,0\n1,inf\n", "a density that is not finite, at point 2"),
    ],
)
def test_tables_that_are_none_are_refused(tmp_path, text, message):
    path = tmp_path / "film.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        load_curve(path)
    with pytest.raises(ValueError, match="this curve cannot be read"):
        load_curve(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: film(LINE, rms_granularity=-1), "RMS granularity is -1; expected 0 or more"),
        (lambda: film(LINE, sensitivity=[1, -1, 1]), "expected shares of red, green and blue"),
        (lambda: film(LINE, paper=response_curve([0, 1], [0.0, 0.5])), "which is no grey of 18 %"),
        (lambda: film(LINE, paper=response_curve([0, 1], [2.0, 0.0])), "lighter with exposure"),
        (lambda: sensor(read_noise=3), "without the full well"),
        (lambda: sensor(full_well=0), "full well is 0 electrons; expected above 0"),
        (lambda: sensor(full_well=10, read_noise=-1), "read noise is -1 electrons"),
        (lambda: sensor(base_iso=0), "ISO speed is 0"),
        (lambda: photograph(jnp.ones((1, 1, 3)), SETTINGS, luminance=0), "luminance of radiance 1 is 0"),
        (
            lambda: develop(jnp.ones((1, 1, 3)), Sensor(), balance=jnp.array([1.0, 0.0, 1.0])),
            "white balance is",
        ),
    ],
)
def test_films_and_sensors_that_are_none_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


LINE = response_curve([-1.0, 1.0], [0.0, 2.0])
SETTINGS = camera_settings(f_number=4, time=0.01)
