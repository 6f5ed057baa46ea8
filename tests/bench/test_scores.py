"""The band near silhouettes, time at equal error, and how methods are asked for."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera

from focusjax.bench import METHODS, ChoiceError, chosen_methods, near_silhouettes, time_to_reach
from focusjax.lens import ThinLens


def test_the_band_is_as_wide_as_the_larger_blur():
    """A strip 4 pixels blurred in radius, before a background in focus."""
    camera = front_camera(40, 20)
    lens = ThinLens(jnp.array(0.5), jnp.array(8.0) / camera.focal_px)
    disparity = np.full((20, 40), 0.5)
    disparity[:, 18:] = 1.0
    band = near_silhouettes(disparity, camera, lens)
    # The jump's two columns, 17 and 18, and 4 + 1 pixels on either side.
    assert np.flatnonzero(band.any(axis=0)).tolist() == list(range(12, 24))
    np.testing.assert_array_equal(band, np.broadcast_to(band[0], band.shape))


def test_slopes_and_faint_jumps_are_no_silhouettes():
    camera = front_camera(40, 20)
    lens = ThinLens(jnp.array(0.5), jnp.array(8.0) / camera.focal_px)
    slope = np.broadcast_to(np.linspace(0.2, 1.2, 40), (20, 40))
    assert not near_silhouettes(slope, camera, lens).any()
    step = np.where(np.arange(40) < 20, 0.5, 0.56) + np.zeros((20, 1))
    assert not near_silhouettes(step, camera, lens).any()


def test_time_is_read_off_between_the_points():
    points = [(4.0, 40.0), (1.0, 30.0), (16.0, 45.0)]
    assert time_to_reach(points, 35.0).seconds == pytest.approx(2.0)
    assert time_to_reach(points, 42.5).seconds == pytest.approx(8.0)
    assert not time_to_reach(points, 35.0).at_most


def test_a_slower_and_worse_setting_does_not_count():
    points = [(1.0, 30.0), (2.0, 29.0), (4.0, 40.0)]
    assert time_to_reach(points, 35.0).seconds == pytest.approx(2.0)


def test_beyond_the_points():
    points = [(1.0, 30.0), (4.0, 40.0)]
    assert time_to_reach(points, 40.1).seconds == math.inf
    assert time_to_reach(points, 40.0).seconds == 4.0
    quick = time_to_reach(points, 20.0)
    assert (quick.seconds, quick.at_most) == (1.0, True)
    exact = time_to_reach(points, 30.0)
    assert (exact.seconds, exact.at_most) == (1.0, False)
    assert time_to_reach([(1.0, 30.0), (4.0, math.inf)], 35.0).seconds == pytest.approx(4.0)


def test_names_with_settings():
    chosen = chosen_methods(["tracer=4,32", "scatter=0.5", "gather"])
    assert [method.name for method in chosen] == ["tracer", "scatter", "gather"]
    usual = next(method.settings for method in METHODS if method.name == "gather")
    assert [method.settings for method in chosen] == [(4, 32), (0.5,), usual]


def test_all_that_are_installed_by_default():
    names = [method.name for method in chosen_methods([])]
    assert {"tracer", "raycast", "gather", "scatter", "multilayer", "accumulation"} <= set(names)
    assert "mitsuba-scalar" not in names


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["blur"], r"no method named 'blur'; expected one of tracer, tracer-1, mitsuba, mitsuba\+oidn"),
        (["gather", "gather=4"], "gather is asked for twice"),
        (["gather=4,x"], "settings of gather are '4,x'; expected positive numbers such as gather=16,64"),
        (["scatter=0"], "settings of scatter are '0'; expected positive numbers such as scatter=0.5,1"),
        (["gather="], "settings of gather are ''"),
    ],
)
def test_bad_choices(words, sentence):
    with pytest.raises(ChoiceError, match=sentence):
        chosen_methods(words)


def test_what_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ChoiceError, match=r"mitsuba needs mitsuba, which is not installed; run `pip install"):
        chosen_methods(["mitsuba"])
    with pytest.raises(ChoiceError, match=r"mitsuba\+oidn needs mitsuba and pyoidn, which are not installed"):
        chosen_methods(["mitsuba+oidn"])
    assert [method.name for method in chosen_methods([])] == ["tracer", "tracer-1", "post"]
