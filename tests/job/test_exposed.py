"""Aperture, time and speed together with focus: closed forms of depth of field and of exposure."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.film import GREY
from focusjax.focus import ArgumentError, AtLeast, AtMost, AtPoint, FocusPoint, locate, solve
from focusjax.geometry import look_at
from focusjax.job import open_for_light, solve_exposed
from focusjax.lens import depth_of_field, depth_of_field_lens, thin_lens

CAMERA = look_at((0, 0, 0), (0, 0, -1), width=600, height=400, focal_length=0.05)
START = thin_lens(focus_distance=9.0, f_number=1.4, focal_length=0.05)
CIRCLE = 0.5
NEAR, FAR = 2.0, 4.0
HAND = {"longest_time": 1 / 60, "iso_range": (100.0, 1600.0)}


@pytest.fixture(scope="module")
def points():
    """Two posts, both to be blurred by half a pixel at most."""
    wishes = [FocusPoint(AtPoint((0, 0, -z)), AtMost(CIRCLE), name=f"post at {z:g} m") for z in (NEAR, FAR)]
    return locate(wishes, CAMERA)


def depth_f_number(span: float) -> float:
    """f / (2 E) where 2 f_px E (w_n - w_f) / 2 = c."""
    return float(CAMERA.focal_length * CAMERA.focal_px) * span / (2.0 * CIRCLE)


def f_number_for(luminance: float, time: float, iso: float, focus_disparity: float) -> float:
    """N where pi L g t S / (4 N^2 (1 + m)^2) is the 10 ISO seconds of a grey."""
    enlarged = 0.05 * focus_disparity / (1.0 - 0.05 * focus_disparity)
    return np.sqrt(np.pi / 4.0 * luminance * GREY * time * iso / 10.0) / (1.0 + enlarged)


@pytest.mark.parametrize("priority", ["focus", "exposure"])
def test_where_there_is_light_enough_depth_is_met_by_the_widest_aperture(points, priority):
    """A start far off leads there, too, which the solve alone leaves open."""
    found = solve_exposed(points, CAMERA, START, GREY, {"luminance": 2000.0, **HAND}, priority=priority)
    number = depth_f_number(1 / NEAR - 1 / FAR)
    # Observed 2e-10 off; in 38 random cases at single precision within 5e-4 stops.
    assert float(found.solution.lens.f_number(CAMERA)) == pytest.approx(number, rel=1e-6)
    assert float(found.solution.lens.focus_disparity) == pytest.approx(0.375, rel=1e-6)
    alone = solve(points, CAMERA, START, free=("focus", "f_number"))
    assert float(alone.lens.f_number(CAMERA)) > 2 * number
    settings = found.chosen.settings
    assert float(settings.time) == pytest.approx(1 / 60)
    assert f_number_for(2000.0, 1 / 60, float(settings.iso), 0.375) == pytest.approx(
        float(settings.f_number), rel=1e-6
    )
    assert found.chosen.limits == ()
    assert found.sentence() is None


def test_exposure_first_opens_the_lens_as_far_as_the_light_takes(points):
    dim = {"luminance": 20.0, **HAND}
    found = solve_exposed(points, CAMERA, START, GREY, dim, priority="exposure")
    wanted, number = depth_f_number(0.25), f_number_for(20.0, 1 / 60, 1600.0, 0.375)
    assert float(found.solution.lens.f_number(CAMERA)) == pytest.approx(number, rel=1e-6)  # observed 2e-11
    assert abs(float(found.chosen.stops_off)) < 1e-6
    missed = CIRCLE * (wanted / number - 1.0)
    np.testing.assert_allclose(found.solution.error, [missed, missed], rtol=1e-6)
    assert found.exposed.stops_apart() == pytest.approx(2 * np.log2(wanted / number), abs=1e-6)
    assert found.sentence() == (
        "The wishes for focus take f/10; at 1/60 s and ISO 1600 the light is right for f/2.7, 3.9 stops"
        " wider. Focus gives way: 'post at 2 m' misses its wish by 1.4 px."
    )
    # A lens that does not open as far leaves both wanting.
    start = thin_lens(focus_distance=9.0, f_number=4.0, focal_length=0.05)
    slow = solve_exposed(points, CAMERA, start, GREY, dim, priority="exposure", f_number_range=(4.0, 16.0))
    assert float(slow.chosen.stops_off) == pytest.approx(2 * np.log2(number / 4.0), abs=1e-3)
    assert slow.sentence().endswith("The lens goes to f/4, where the picture is 1.1 stops too dark.")


def test_focus_first_leaves_the_picture_too_dark(points):
    found = solve_exposed(points, CAMERA, START, GREY, {"luminance": 20.0, **HAND})
    off = 2 * np.log2(f_number_for(20.0, 1 / 60, 1600.0, 0.375) / depth_f_number(0.25))
    assert float(found.chosen.stops_off) == pytest.approx(off, abs=1e-6)
    assert found.sentence().endswith("Exposure gives way: the picture is 3.9 stops too dark.")
    assert bool(jnp.all(found.solution.met))


def test_too_much_light_closes_the_lens():
    """What wants a wide lens in the sun is met by focusing closer, where the lens also loses more light."""
    wishes = [FocusPoint(AtPoint((0, 0, -4)), AtLeast(20)), FocusPoint(AtPoint((0, 0, -2)), AtMost(0.5))]
    sun = {"luminance": 1e6, **HAND}
    found = solve_exposed(locate(wishes, CAMERA), CAMERA, START, GREY, sun, priority="exposure")
    assert found.exposed.stops_apart() < 0
    number = f_number_for(1e6, 1 / 8000, 100.0, float(found.solution.lens.focus_disparity))
    assert float(found.solution.lens.f_number(CAMERA)) == pytest.approx(number, rel=1e-4)  # observed 3e-6
    assert "at 1/8000 s and ISO 100 the light is right for f/" in found.sentence()
    assert "stops narrower. Focus gives way" in found.sentence()


def test_a_given_depth_of_field_shrinks_where_exposure_goes_first():
    lens = depth_of_field_lens(CAMERA, NEAR, FAR)
    dim = {"luminance": 20.0, **HAND}
    found = open_for_light(lens, CAMERA, GREY, dim, priority="exposure")
    number = f_number_for(20.0, 1 / 60, 1600.0, 0.375)
    assert float(found.lens.f_number(CAMERA)) == pytest.approx(number, rel=1e-9)
    half = 0.125 * number / float(lens.f_number(CAMERA))
    sharp = depth_of_field(CAMERA, found.lens)
    np.testing.assert_allclose([sharp.near, sharp.far], [1 / (0.375 + half), 1 / (0.375 - half)], rtol=1e-9)
    assert "Focus gives way: at f/2.7 it is sharp from 2.46 to 2.91 m." in found.sentence()
    same = open_for_light(lens, CAMERA, GREY, dim)
    assert same.lens.f_number(CAMERA) == lens.f_number(CAMERA)


def test_what_cannot_be_weighed_is_refused(points):
    light = {"luminance": 20.0}
    with pytest.raises(ArgumentError, match="without an f-number for depth of field and light to settle"):
        solve_exposed(points, CAMERA, START, GREY, light, free=("focus",))
    with pytest.raises(ValueError, match="the metered radiance is 0, for which no settings are right"):
        solve_exposed(points, CAMERA, START, 0.0, light)
