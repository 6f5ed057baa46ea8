"""Depth of field against the textbook's formulas, and how numbers are written."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.geometry import make_camera
from focusjax.lens import depth_of_field, thin_lens
from focusjax.report import f_number, metres


@pytest.fixture
def camera():
    return make_camera(jnp.eye(4), width=600, height=400, focal_length=0.05)


def lens(**settings):
    return thin_lens(focal_length=0.05, **settings)


@pytest.mark.parametrize("focus_distance", [0.8, 3.0, 12.0])
def test_near_and_far_are_where_blur_is_the_circle(camera, focus_distance):
    made = lens(focus_distance=focus_distance, f_number=2.0)
    sharp = depth_of_field(camera, made)
    for distance, side in ((sharp.near, -1), (sharp.far, 1)):
        blur = made.blur(camera, jnp.zeros(2), jnp.asarray(1 / distance))
        np.testing.assert_allclose(blur, side * sharp.circle_px, rtol=1e-9)  # observed 3e-14


def test_hyperfocal_distance_is_the_textbooks(camera):
    sharp = depth_of_field(camera, lens(focus_distance=3.0, f_number=2.0))
    # H = f^2 / (N c), where the film stays a focal length behind the lens.
    np.testing.assert_allclose(sharp.hyperfocal, 50**2 / (2.0 * sharp.circle_mm) / 1000, rtol=1e-9)
    diagonal = np.hypot(36.0, 24.0)
    np.testing.assert_allclose(sharp.circle_mm, diagonal / 1500, rtol=1e-9)


def test_focused_on_the_hyperfocal_distance_half_of_it_to_infinity_is_sharp(camera):
    hyperfocal = depth_of_field(camera, lens(focus_distance=3.0, f_number=8.0)).hyperfocal
    sharp = depth_of_field(camera, lens(focus_distance=1.0001 * hyperfocal, f_number=8.0))
    np.testing.assert_allclose(sharp.near, hyperfocal / 2, rtol=1e-3)
    assert np.isinf(sharp.far)


def test_a_pinhole_and_infinity_have_finite_words(camera):
    pinhole = depth_of_field(camera, lens(focus_distance=3.0, aperture_radius=0.0))
    assert (pinhole.near, pinhole.far, pinhole.hyperfocal) == (0.0, np.inf, 0.0)
    far = depth_of_field(camera, lens(focus_distance=np.inf, f_number=2.0))
    np.testing.assert_allclose(far.near, far.hyperfocal)
    assert np.isinf(far.far)


@pytest.mark.parametrize(
    ("value", "text"), [(0.716, "71.6 cm"), (2.314, "2.31 m"), (123.4, "123 m"), ("inf", "∞"), (np.inf, "∞")]
)
def test_metres(value, text):
    assert metres(value) == text


@pytest.mark.parametrize(("value", "text"), [(1.96, "f/2.0"), (11.2, "f/11"), ("inf", "pinhole")])
def test_f_number(value, text):
    assert f_number(value) == text
