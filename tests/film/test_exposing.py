"""Metering, chosen settings, white balance, fitted settings and long exposures."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients

from focusjax.film import (
    GREY,
    LUMINANCE,
    Zone,
    balance_for,
    brightness,
    camera_settings,
    choose_settings,
    expose_frames,
    film_preset,
    fit_settings,
    grey_world_balance,
    meter,
    metering_weights,
    photograph,
    start_exposure,
)
from focusjax.geometry import look_at
from focusjax.lens import depth_of_field_lens

BASE = camera_settings(f_number=4, time=1 / 60, iso=100)


def scene(seed: int = 0, height: int = 12, width: int = 18) -> jnp.ndarray:
    """Radiance over three decades, with colours."""
    random = np.random.default_rng(seed)
    return jnp.asarray(10.0 ** random.uniform(-2, 1, (height, width, 1)) * random.uniform(0.5, 1, (1, 1, 3)))


def test_a_grey_world_is_metered_by_its_mean():
    image = scene()
    assert meter(image) == pytest.approx(float(jnp.mean(brightness(image))), rel=1e-12)
    settings = choose_settings(meter(image), BASE, luminance=50).settings
    shown = photograph(image, settings, luminance=50)
    # Observed 4e-16 off: no pixel is full.
    assert jnp.mean(brightness(shown)) == pytest.approx(GREY, rel=1e-12)


def test_meters_weigh_the_picture():
    weights = metering_weights("centre", 90, 60)
    y, x = np.mgrid[0.5:60, 0.5:90]
    disk = np.hypot(x - 45, y - 30) <= 15
    assert weights.sum() == pytest.approx(1.0)
    assert weights[disk].sum() == pytest.approx(0.75)
    image = jnp.ones((60, 90, 3)).at[:20].set(9.0)
    assert meter(image, "average") == pytest.approx((9 + 2) / 3)
    assert meter(image, Zone((0, 0, 90, 20))) == pytest.approx(9.0)
    mask = np.zeros((60, 90))
    mask[10:30] = 1
    assert meter(image, Zone(mask)) == pytest.approx(5.0)
    for size in ((1, 1), (2, 3)):
        assert metering_weights("centre", *size).sum() == pytest.approx(1.0)


def test_zones_are_met_as_well_as_can_be_in_stops():
    """The metered radiance is the least-squares solution, and any other is worse."""
    image = jnp.concatenate([jnp.full((4, 4, 3), 0.5), jnp.full((4, 4, 3), 8.0)], axis=1)
    zones = (Zone((0, 0, 4, 4), stops=-1, weight=2.0), Zone((4, 0, 4, 4), stops=1))
    grey = meter(image, *zones)

    def error(radiance):
        left = [np.log2(0.5 / radiance) + 1, np.log2(8.0 / radiance) - 1]
        return 2.0 * left[0] ** 2 + left[1] ** 2

    assert error(float(grey)) < min(error(float(grey) * 1.01), error(float(grey) / 1.01))
    # 2 stops of weight 2 from the shadow, at 0 stops, and 1 from the light at 2: log2 g = 2 / 3.
    assert grey == pytest.approx(2 ** (2 / 3), rel=1e-12)


def test_speed_stays_low_until_the_time_is_too_long():
    for luminance, time, iso, limits in [
        (1e6, 1 / 8000, 100.0, ("shortest time", "lowest ISO speed")),
        (2000.0, None, 100.0, ()),
        (60.0, 1 / 60, None, ()),
        (0.5, 1 / 60, 6400.0, ("longest time", "highest ISO speed")),
    ]:
        chosen = choose_settings(GREY, BASE, luminance=luminance)
        assert chosen.limits == limits
        signal = chosen.settings.signal(jnp.asarray(luminance * GREY))
        assert jnp.log2(signal / GREY) == pytest.approx(float(chosen.stops_off), abs=1e-12)
        assert not limits or abs(float(chosen.stops_off)) > 1
        assert time is None or float(chosen.settings.time) == pytest.approx(time)
        assert iso is None or float(chosen.settings.iso) == pytest.approx(iso)
        right = dataclasses.replace(chosen.settings, f_number=chosen.right_f_number())
        assert right.signal(jnp.asarray(luminance * GREY)) == pytest.approx(GREY)


def test_what_is_not_free_stays_and_compensation_counts():
    chosen = choose_settings(GREY, BASE, luminance=300, free=("time",), compensation=1.0, longest_time=10)
    assert chosen.settings.iso == BASE.iso
    assert chosen.settings.signal(jnp.asarray(300 * GREY)) == pytest.approx(2 * GREY)
    chosen = choose_settings(GREY, BASE, luminance=300, free=("iso",))
    assert chosen.settings.time == BASE.time


def test_f_numbers_for_light_are_those_of_the_times_and_speeds_that_are_left():
    base = camera_settings(f_number=4, time=1 / 30, iso=400)
    found = choose_settings(GREY, base, luminance=50.0, free=("time",), longest_time=1 / 60).f_numbers
    # Where pi L g t S / (4 N^2) is the 10 ISO seconds of a grey.
    for number, time in ((found.narrowest, 1 / 60), (found.widest, 1 / 8000)):
        assert float(number) == pytest.approx(np.sqrt(np.pi / 4 * 50.0 * GREY * time * 400 / 10), rel=1e-9)
    assert found.quietest == found.narrowest
    both = choose_settings(GREY, base, luminance=50.0).f_numbers
    assert float(both.narrowest / both.quietest) == pytest.approx(8.0)


def test_depth_of_field_at_correct_exposure_held_by_hand():
    """Aperture, time and speed from what is to be sharp, the light, and a limit of 1/60 s."""
    camera = look_at((0, 0, 0), (0, 0, -1), width=600, height=400, focal_length=0.05)
    lens = depth_of_field_lens(camera, 2.0, 4.0)
    circle = np.hypot(600, 400) / 1500
    middle = jnp.array([300.0, 200.0])
    blur = [float(lens.blur(camera, middle, jnp.array(1 / z))) for z in (2.0, 4.0)]
    np.testing.assert_allclose(blur, [-circle, circle], rtol=1e-9)  # observed 3e-16
    settings = dataclasses.replace(BASE, f_number=lens.f_number(camera))
    chosen = choose_settings(GREY, settings, luminance=200.0, longest_time=1 / 60)
    assert chosen.limits == ()
    assert chosen.settings.time == pytest.approx(1 / 60)
    assert 100 < float(chosen.settings.iso) < 6400
    assert chosen.settings.signal(jnp.asarray(200.0 * GREY)) == pytest.approx(GREY)
    # Nothing is as shallow as it opens; to infinity is a range, too.
    assert depth_of_field_lens(camera, 2.0, 2.0001).f_number(camera) == pytest.approx(1.0)
    assert depth_of_field_lens(camera, 5.0, np.inf).focus_distance() == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((0.0, 1.0), "from 0 to 1 m; expected the nearer end first, above 0"),
        ((3.0, 2.0), "from 3 to 2 m; expected the nearer end first"),
        ((0.5, np.inf), "takes f/86.7, and the lens stops down to f/32, for 0.73 to 1.59 m"),
    ],
)
def test_depths_that_no_lens_has_are_refused(given, message):
    camera = look_at((0, 0, 0), (0, 0, -1), width=600, height=400, focal_length=0.05)
    with pytest.raises(ValueError, match=re.escape(message)):
        depth_of_field_lens(camera, *given)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: choose_settings(0.0, BASE, luminance=1), "metered radiance is 0, for which no settings"),
        (lambda: choose_settings(1.0, BASE, luminance=0), "luminance of radiance 1 is 0; expected cd/m"),
        (lambda: choose_settings(1.0, BASE, luminance=1, free=("f_number",)), "expected some of"),
        (lambda: choose_settings(1.0, BASE, luminance=1, longest_time=0), "longest time is 0"),
        (lambda: choose_settings(1.0, BASE, luminance=1, iso_range=(800, 100)), "from 800 to 100; swap"),
        (lambda: choose_settings(1.0, BASE, luminance=1, iso_range=(0, 100)), "ISO speed is 0"),
        (lambda: meter(scene(), Zone((10, 0, 20, 5))), "not within the picture of 18 x 12 pixels; move it"),
        (lambda: meter(scene(), Zone(np.zeros((12, 18)))), "mark what is to be metered"),
        (lambda: meter(scene(), Zone(np.ones((3, 3)))), "expected a mask of .12, 18., or 4 numbers"),
        (lambda: meter(scene(), Zone("average", weight=0)), "weight is 0; expected a positive number"),
        (lambda: balance_for(1000), "temperature is 1000 K; expected from 2000"),
        (
            lambda: choose_settings(1.0, BASE, luminance=1, compensation=2000),
            "2000 stops; expected at most 50",
        ),
        (lambda: choose_settings(1.0, BASE, luminance=1, compensation=np.nan), "compensation is nan stops"),
        (lambda: start_exposure(18, 12).add(scene()[:1]), r"\(1, 18, 3\); expected \(12, 18, 3\)"),
        (lambda: start_exposure(18, 12).add(scene(), -3.0), "duration is -3; expected a time that is finite"),
        (lambda: start_exposure(18, 12).add(scene(), np.nan), "duration is nan"),
        (lambda: expose_frames(scene()[None], np.inf), "duration is inf"),
        (lambda: expose_frames(scene()[None], jnp.ones(3)), "1 frames and durations of shape .3,.; give one"),
    ],
)
def test_what_cannot_be_metered_or_chosen_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_automatic_exposure_is_differentiable():
    """The chosen speed, by what is in the picture, through the meter."""

    def chosen(image):
        found = choose_settings(meter(image, "centre"), BASE, luminance=40.0)
        return jnp.log2(found.settings.iso)

    slopes = check_gradients(chosen, scene(1, 4, 6))
    assert (slopes < 0).all()


def test_white_balance_makes_a_light_white():
    cold = balance_for(6500)
    np.testing.assert_allclose(cold, jnp.ones(3), rtol=1e-12)
    for kelvin, red_to_blue in ((2856, 7.85), (5500, 1.318), (10000, 0.605)):
        gains = balance_for(kelvin)
        # Red over blue of linear sRGB for the chromaticities of the CIE's tables, over that of 6500 K.
        # Observed 0.6 % off.
        assert float(gains[2] / gains[0]) == pytest.approx(red_to_blue, rel=0.02)
    image = scene(2)
    gains = grey_world_balance(image)
    mean = jnp.mean(image * gains.reshape(1, 1, 3), axis=(0, 1))
    np.testing.assert_allclose(mean, jnp.full(3, jnp.mean(brightness(image))), rtol=1e-12)


NEGATIVE = film_preset("negative", rms_granularity=10)
GAINS = jnp.array([1.2, 1.0, 0.8]) / (jnp.array([1.2, 1.0, 0.8]) @ jnp.asarray(LUMINANCE))


@pytest.mark.parametrize(
    ("medium", "free"),
    [(film_preset("plain"), "f_number"), (NEGATIVE, "time"), (NEGATIVE, "iso"), (NEGATIVE, "f_number")],
    ids=["plain, f-number", "negative, time", "negative, speed", "negative, f-number"],
)
def test_settings_are_recovered_from_a_picture(medium, free):
    """From three stops away, and with them the white balance."""
    image = scene(3)
    target = photograph(image, BASE, medium, luminance=60.0, balance=GAINS)
    start = dataclasses.replace(BASE, **{free: getattr(BASE, free) * (2.9 if free == "f_number" else 8.4)})
    fit = fit_settings(target, image, start, medium, luminance=60.0, free=(free, "white_balance"))
    assert bool(fit.converged)
    # Observed: 2e-16 off; 1 % is wanted.
    assert getattr(fit.settings, free) == pytest.approx(float(getattr(BASE, free)), rel=1e-5)
    np.testing.assert_allclose(fit.balance, GAINS, rtol=1e-5)


def test_settings_are_recovered_from_a_grainy_picture():
    """On half a millimetre of film, for grain that shows."""
    image = scene(4)
    target = photograph(image, BASE, NEGATIVE, luminance=60.0, balance=GAINS, sensor_width=5e-4, seed=5)
    start = dataclasses.replace(BASE, time=BASE.time / 5)
    fit = fit_settings(target, image, start, NEGATIVE, luminance=60.0, free=("time", "white_balance"))
    assert float(fit.rms) > 0.005
    off = abs(float(jnp.log2(fit.settings.time * 60)))
    # Observed 0.04 % off, of a standard error of 0.3 %; 1 % is wanted.
    assert off < np.log2(1.01)
    assert off < 4 * float(fit.stops_error) < 0.05


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (("time", "iso"), "free has 2 of f_number, time, iso; expected one"),
        (("white_balance",), "free has 0 of f_number, time, iso"),
        (("tme",), "free is ('tme',); expected one of"),
        ("time", "free is 'time'; expected one of"),
    ],
)
def test_fits_that_a_picture_does_not_determine_are_refused(free, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        fit_settings(scene(), scene(), BASE, luminance=60.0, free=free)


def test_black_pictures_tell_nothing():
    black = jnp.zeros((12, 18, 3))
    with pytest.raises(ValueError, match="the exposure cannot be estimated"):
        fit_settings(black, black, BASE, luminance=60.0, free=("time", "white_balance"))
    with pytest.raises(ValueError, match="expected one size"):
        fit_settings(scene(), scene(0, 6, 6), BASE, luminance=60.0)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_a_long_exposure_of_a_still_scene_is_one_of_its_frames(dtype):
    frame = scene(6).astype(dtype) * 1e6
    for count in (1, 10, 100):
        exposure = start_exposure(18, 12, dtype=dtype)
        for number in range(count):
            exposure = exposure.add(frame, 0.01 * (number + 1))
        # Observed: equal to every digit; 1e-5 is wanted.
        np.testing.assert_array_equal(exposure.picture, frame)
        assert exposure.picture.dtype == dtype


def test_a_trail_is_evenly_bright_however_finely_time_is_cut():
    """A light 4 pixels wide goes 64 pixels in a second, seen in 16, 64 or 256 frames."""
    profiles = []
    for count in (16, 64, 256):
        step = 64 / count
        edges = np.arange(97)
        frames = []
        for number in range(count):
            left = 10 + step * number
            covered = np.clip(np.minimum(edges[1:], left + 4) - np.maximum(edges[:-1], left), 0, 1)
            frames.append(np.broadcast_to(covered[None, :, None], (1, 96, 3)))
        trail = expose_frames(jnp.asarray(np.stack(frames)), 1.0 / count)
        assert trail.time == pytest.approx(1.0)
        profiles.append(np.asarray(trail.picture)[0, :, 0])
        # The light is on each point of its way for 4 / 64 of the time; observed within 1e-15.
        np.testing.assert_allclose(profiles[-1][15:70], 4 / 64, rtol=1e-9)
        assert profiles[-1].sum() == pytest.approx(4.0)


def test_a_long_exposure_may_be_stopped_and_gone_on_with():
    frames = jnp.stack([scene(seed) for seed in range(5)])
    durations = jnp.array([1.0, 2.0, 0.0, 0.5, 3.0])
    whole = expose_frames(frames, durations)
    wanted = jnp.einsum("n,nhwc->hwc", durations, frames) / durations.sum()
    np.testing.assert_allclose(whole.picture, wanted, rtol=1e-12)  # observed 4e-16

    def add(exposure, each):
        return exposure.add(*each), None

    half, _ = jax.lax.scan(add, start_exposure(18, 12), (frames[:2], durations[:2]))
    rest, _ = jax.lax.scan(add, half, (frames[2:], durations[2:]))
    np.testing.assert_allclose(rest.picture, wanted, rtol=1e-12)
    check_gradients(lambda f, d: expose_frames(f, d).picture, frames[:2, :2, :2], durations[:2])
    first = jax.grad(lambda d: expose_frames(frames[:1], d).picture.sum())(jnp.zeros(1))
    assert np.isfinite(np.asarray(first)).all()
