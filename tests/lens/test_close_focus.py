"""Image distance, f-number, blur and framing near the lens, against the formulas of the papers."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients
from small_scenes import SQUARE

import focusjax as fj
from focusjax.film import settings_through
from focusjax.geometry import make_camera
from focusjax.lens import (
    as_tilt_shift,
    at_image_distance,
    close_focus_lens,
    depth_of_field,
    focus_scale,
    lens_settings,
    prescription_lens,
    require_close_focus,
    thin_lens,
)
from focusjax.optics import lens_preset

MODELS = ("framing", "breathing")


@pytest.fixture
def camera():
    """50 mm, a sensor of 45 mm from corner to corner, and pixels of a millimetre."""
    return make_camera(jnp.eye(4), width=36, height=27, focal_length=0.05)


def circle_mm(camera, lens, distance):
    blur = lens.blur(camera, camera.principal_point, jnp.asarray(1.0 / distance))
    return float(blur) * float(camera.sensor_width) / camera.width * 1000


def textbook_circle_mm(focal_length, f_number, focus_distance, distance):
    """Lee09 eq. 1: |v - v_d| / v E, with v the image distances and E the diameter of the opening."""
    in_focus = focal_length * focus_distance / (focus_distance - focal_length)
    of_point = focal_length * distance / (distance - focal_length)
    return 1000 * abs(in_focus - of_point) / of_point * focal_length / f_number


def test_the_papers_circle_of_confusion(camera):
    near, lens = close_focus_lens(camera, "breathing", focus_distance=0.5, f_number=2)
    assert circle_mm(near, lens, 1.0) == pytest.approx(25 / 18, rel=1e-12)  # 1.389 mm; observed 2e-16
    ideal = thin_lens(focus_distance=0.5, f_number=2, focal_length=0.05)
    assert circle_mm(camera, ideal, 1.0) == pytest.approx(1.25, rel=1e-12)


@pytest.mark.parametrize("distance", [0.15, 0.4, 1.0, 30.0])
@pytest.mark.parametrize("focus_distance", [0.1, 0.5, 5.0])
@pytest.mark.parametrize("model", MODELS)
def test_blur_is_the_textbooks_for_the_lens_that_is_set(camera, model, focus_distance, distance):
    near, lens = close_focus_lens(camera, model, focus_distance=focus_distance, f_number=2.8)
    length = float(lens_settings(near, lens, model).focal_length)
    expected = textbook_circle_mm(length, 2.8, focus_distance, distance)
    # Observed 5e-15.
    assert abs(circle_mm(near, lens, distance)) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_depth_of_field_is_the_textbooks(camera):
    near, lens = close_focus_lens(camera, "breathing", focus_distance=5, f_number=8)
    sharp = depth_of_field(near, lens, "breathing")
    f, n, c, d = 0.05, 8.0, 30e-6, 5.0
    assert sharp.circle_mm == pytest.approx(0.03, rel=1e-12)
    hyperfocal = f**2 / (n * c) + f
    assert sharp.hyperfocal == pytest.approx(hyperfocal, rel=1e-12)
    # Observed 2e-16; these are 3.389 and 9.527 m.
    assert sharp.near == pytest.approx(d * (hyperfocal - f) / (hyperfocal + d - 2 * f), rel=1e-12)
    assert sharp.far == pytest.approx(d * (hyperfocal - f) / (hyperfocal - d), rel=1e-12)
    assert (round(sharp.near, 3), round(sharp.far, 3)) == (3.389, 9.527)
    ideal = depth_of_field(camera, thin_lens(focus_distance=5, f_number=8, focal_length=0.05))
    assert (round(ideal.near, 3), round(ideal.far, 3)) == (3.378, 9.615)


@pytest.mark.parametrize("model", MODELS)
def test_focused_on_the_hyperfocal_distance_infinity_is_just_sharp(camera, model):
    near, lens = close_focus_lens(camera, model, focus_distance=0.7, f_number=8)
    hyperfocal = depth_of_field(near, lens, model).hyperfocal
    there, refocused = close_focus_lens(camera, model, focus_distance=hyperfocal, f_number=8)
    blur = refocused.blur(there, there.principal_point, jnp.zeros(()))
    # Observed 2e-16.
    assert float(blur) == pytest.approx(depth_of_field(there, refocused, model).circle_px, rel=1e-12)


def test_life_size(camera):
    length = 0.05
    near, lens = close_focus_lens(camera, "breathing", focus_distance=2 * length, f_number=4)
    found = lens_settings(near, lens, "breathing")
    np.testing.assert_allclose(found.image_distance, 2 * length, rtol=1e-12)
    np.testing.assert_allclose(found.magnification, 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.working_f_number(), 8.0, rtol=1e-12)
    # A thing of 10 mm in focus is 10 mm on the sensor, on which pixels are millimetres.
    place = near.project(jnp.array([0.01, 0.0, -2 * length]))[0] - near.principal_point
    np.testing.assert_allclose(place, [10.0, 0.0], atol=1e-12)
    kept, lens = close_focus_lens(camera, "framing", focus_distance=length, f_number=4)
    found = lens_settings(kept, lens, "framing")
    np.testing.assert_allclose(found.focal_length, length / 2, rtol=1e-12)
    np.testing.assert_allclose(found.magnification, 1.0, rtol=1e-12)
    np.testing.assert_allclose(lens.aperture_radius, length / 2 / 8, rtol=1e-12)


@pytest.mark.parametrize("focus_distance", [0.101, 0.5, 4.0, np.inf])
@pytest.mark.parametrize("model", ["ignored", *MODELS])
def test_what_is_set_is_read_off_again(camera, model, focus_distance):
    near, lens = close_focus_lens(camera, model, focus_distance=focus_distance, f_number=2.8)
    found = lens_settings(near, lens, model)
    np.testing.assert_allclose(found.f_number, 2.8, rtol=1e-12)
    np.testing.assert_allclose(1.0 / lens.focus_disparity, focus_distance, rtol=1e-12)
    kept = found.image_distance if model == "framing" else found.focal_length
    np.testing.assert_allclose(kept, 0.05, rtol=1e-12)
    # 1 / F = 1 / s + w, and light goes by the image distance over the opening.
    if model != "ignored":
        power = 1 / found.image_distance + lens.focus_disparity
        np.testing.assert_allclose(1 / found.focal_length, power, rtol=1e-12)
        opened = found.image_distance / (2 * lens.aperture_radius)
        np.testing.assert_allclose(found.working_f_number(), opened, rtol=1e-12)


def test_all_models_agree_at_infinity(camera):
    made = [close_focus_lens(camera, model, focus_distance=np.inf, f_number=2) for model in MODELS]
    ideal = thin_lens(focus_distance=np.inf, f_number=2, focal_length=0.05)
    for near, lens in made:
        assert float(near.focal_length) == 0.05
        assert float(lens.aperture_radius) == float(ideal.aperture_radius)


@pytest.mark.parametrize("model", MODELS)
def test_blur_is_linear_in_the_setting_of_the_focus(camera, model):
    scale, w = focus_scale(camera, model), jnp.asarray(3.0)
    settings = jnp.linspace(0.0, float(scale.setting(jnp.asarray(9.0))), 5)

    def blur(setting):
        distance = 1.0 / scale.disparity(setting)
        near, lens = close_focus_lens(camera, model, focus_distance=distance, f_number=4)
        return lens.blur(near, near.principal_point, w)

    got = jnp.stack([blur(setting) for setting in settings])
    expected = camera.focal_px * camera.focal_length / 4 * (settings * scale.gain(w) - w)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)  # observed 3e-15


@pytest.mark.parametrize("model", MODELS)
def test_gradients(camera, model):
    def answer(distance, number, length):
        framed = dataclasses.replace(camera, focal_length=length)
        near, lens = close_focus_lens(framed, model, focus_distance=distance, f_number=number)
        blur = lens.blur(near, near.principal_point, jnp.asarray(2.0))
        found = lens_settings(near, lens, model)
        return blur, found.focal_length, found.magnification, found.working_f_number()

    # Observed 6e-9 of the largest slope.
    check_gradients(answer, *(jnp.asarray(value) for value in (0.3, 2.8, 0.05)))


@pytest.mark.parametrize("model", MODELS)
def test_a_point_of_light_is_rendered_as_wide_as_the_formula_says(camera, model):
    camera = make_camera(jnp.eye(4), width=48, height=48, focal_length=0.05, sensor_width=0.012)
    near, lens = close_focus_lens(camera, model, focus_distance=0.25, f_number=1.6)
    half = 0.005
    corners = [(-half, -half, -0.5), (half, -half, -0.5), (half, half, -0.5), (-half, half, -0.5)]
    card = fj.make_object("card", corners, SQUARE, colour=(0, 0, 0), emission=1.0)
    layers = fj.peel(fj.make_scene([card]), near, lens)

    def spread(image):
        light = np.asarray(image).sum(axis=-1)
        middles = np.arange(light.shape[1]) + 0.5
        across = light.sum(axis=0) / light.sum()
        return across @ (middles - across @ middles) ** 2

    # The variance of a disk across its diameter is diameter^2 / 16; the pixels' own is that of both pictures.
    stopped = dataclasses.replace(lens, aperture_radius=0.1 * lens.aperture_radius)
    wide, narrow = (fj.render(layers, each, rays=256, smooth=False) for each in (lens, stopped))
    widened = (spread(wide) - spread(narrow)) / (1.0 - 0.1**2)
    length = float(lens_settings(near, lens, model).focal_length)
    expected = textbook_circle_mm(length, 1.6, 0.25, 0.5) / 0.25
    assert expected > 10.0
    # Observed 0.5 %.
    assert 4.0 * np.sqrt(widened) == pytest.approx(expected, rel=0.01)


def test_exposure_goes_by_image_distance_over_opening(camera):
    for model in MODELS:
        near, lens = close_focus_lens(camera, model, focus_distance=0.2, f_number=4)
        settings = settings_through(lens, near, time=1 / 60, close_focus=model)
        working = float(near.focal_length / (2 * lens.aperture_radius))
        np.testing.assert_allclose(settings.f_number, 4.0, rtol=1e-12)
        np.testing.assert_allclose(settings.effective_f_number(), working, rtol=1e-12)
        np.testing.assert_allclose(settings.magnification, near.focal_length / 0.2, rtol=1e-12)
        np.testing.assert_allclose(settings.illuminance(jnp.ones(())), np.pi / 4 / working**2, rtol=1e-12)


def test_only_breathing_moves_the_sensor(camera):
    disparity = jnp.asarray(4.0)
    assert at_image_distance(camera, disparity, "framing") is camera
    assert at_image_distance(camera, disparity, "ignored") is camera
    moved = at_image_distance(camera, disparity, "breathing")
    np.testing.assert_allclose(moved.focal_length, 0.0625, rtol=1e-12)
    np.testing.assert_allclose(moved.principal_point, camera.principal_point)


@pytest.mark.parametrize("model", MODELS)
def test_it_runs_traced_and_in_single_precision(camera, model):
    def blur(distance):
        near, lens = close_focus_lens(camera, model, focus_distance=distance, f_number=2)
        return lens.blur(near, near.principal_point, jnp.asarray(1.0))

    np.testing.assert_allclose(jax.jit(blur)(0.5), blur(0.5), rtol=1e-12)


def test_bad_input_is_refused_in_words(camera):
    with pytest.raises(ValueError, match="close_focus is 'fixed'; expected one of 'ignored', 'framing'"):
        require_close_focus("fixed")
    with pytest.raises(ValueError, match=r"focus distance 0.04 m is within the focal length 0.05 m"):
        close_focus_lens(camera, "breathing", focus_distance=0.04, f_number=2)
    with pytest.raises(ValueError, match="expected a positive distance or infinity"):
        close_focus_lens(camera, "framing", focus_distance=0, f_number=2)
    with pytest.raises(ValueError, match="f-number is -2"):
        close_focus_lens(camera, "framing", focus_distance=1, f_number=-2)
    with pytest.raises(ValueError, match="close_focus is None"):
        require_close_focus(None)


def test_a_turned_lens_is_read_on_its_view_axis(camera):
    near, lens = close_focus_lens(camera, "breathing", focus_distance=0.5, f_number=4)
    read = lens_settings(near, as_tilt_shift(lens), "breathing")
    np.testing.assert_allclose(read.f_number, 4.0, rtol=1e-12)


def test_the_light_of_a_real_lens_is_its_own(camera):
    glass = prescription_lens(lens_preset("cooke_triplet_50mm_f4"), camera, focus_distance=2.0)
    with pytest.raises(ValueError, match="the lens is a PrescriptionLens, whose glass says"):
        settings_through(glass, camera, time=1 / 60, close_focus="framing")
