"""The thin lens in a photographer's terms."""

import equinox as eqx
import jax
import numpy as np
import pytest

from focusjax.geometry import make_camera
from focusjax.lens import Disk, polygon, thin_lens

GOOD = {"focus_distance": 2.0, "focal_length": 0.05, "f_number": 2.0}


def test_an_f_number_sets_the_aperture():
    lens = thin_lens(**GOOD)
    assert float(lens.focus_disparity) == 0.5
    assert float(lens.aperture_radius) == pytest.approx(0.0125)
    assert float(lens.focus_distance()) == 2.0
    camera = make_camera(np.eye(4), width=30, height=20, focal_length=0.05)
    assert float(lens.f_number(camera)) == pytest.approx(2.0)
    assert isinstance(lens.aperture, Disk)


def test_an_aperture_radius_and_blades():
    lens = thin_lens(focus_distance=4.0, aperture_radius=0.01, aperture=polygon(6))
    assert float(lens.aperture_radius) == 0.01
    assert lens.aperture.blades == 6


def test_infinity_is_an_ordinary_focus_and_zero_an_ordinary_aperture():
    lens = thin_lens(focus_distance=np.inf, aperture_radius=0.0)
    assert float(lens.focus_disparity) == 0.0
    assert np.isinf(lens.focus_distance())
    camera = make_camera(np.eye(4), width=30, height=20, focal_length=0.05)
    assert np.isinf(lens.f_number(camera))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"focus_distance": 0.0}, r"focus distance is 0 m; expected a positive distance or infinity"),
        ({"focus_distance": -1.0}, r"focus distance is -1 m; expected a positive distance or infinity"),
        ({"focus_distance": np.nan}, "focus distance is nan m; expected a positive distance or infinity"),
        ({"focal_length": 0.0}, r"focal length is 0 m; expected a positive length"),
        ({"focus_distance": 0.05}, r"focus distance 0\.05 m is within the focal length 0\.05 m"),
        (
            {"focus_distance": 0.05, "focal_length": np.float32(0.05)},
            r"focal length 0\.05 m, where",
        ),
        ({"focus_distance": 0.02}, "forms a real image|form a real image"),
        ({"f_number": None}, "give exactly one of f-number and aperture radius"),
        ({"aperture_radius": 0.1}, "give exactly one of f-number and aperture radius"),
        ({"f_number": 0.0}, r"f-number is 0; expected a positive number such as 2\.8"),
        ({"f_number": -2.8}, r"f-number is -2\.8; expected a positive number"),
        ({"f_number": np.nan}, "f-number is nan; expected a positive number"),
        ({"focal_length": None}, "an f-number needs the focal length; give it, or the aperture radius"),
        (
            {"f_number": None, "aperture_radius": -0.1},
            r"aperture radius is -0\.1 m; expected zero or a positive",
        ),
        (
            {"f_number": None, "aperture_radius": np.inf},
            "aperture radius is inf m; expected zero or a positive",
        ),
        (
            {"f_number": None, "aperture_radius": np.nan},
            "aperture radius is nan m; expected zero or a positive",
        ),
    ],
)
def test_bad_lenses_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        thin_lens(**{**GOOD, **changes})


def test_every_number_may_be_traced():
    def settings(distance, length, f_number):
        lens = thin_lens(focus_distance=distance, focal_length=length, f_number=f_number)
        return lens.focus_disparity, lens.aperture_radius

    by_focus, by_opening = jax.jit(jax.jacrev(settings, argnums=(0, 2)))(2.0, 0.05, 2.0)
    assert by_focus[0] == pytest.approx(-0.25)
    assert by_focus[1] == 0.0
    assert by_opening[0] == 0.0
    assert by_opening[1] == pytest.approx(-0.05 / 8)


@pytest.mark.parametrize(
    ("distance", "length", "f_number", "message"),
    [
        (-1.0, 0.05, 2.0, "focus distance is out of range; expected a positive distance or infinity"),
        (0.04, 0.05, 2.0, "focus distance is within the focal length, where no lens forms a real image"),
        (2.0, -0.05, 2.0, "focal length is out of range; expected a positive length"),
        (2.0, 0.05, np.nan, "f-number is out of range; expected a positive number"),
    ],
)
def test_traced_numbers_out_of_range_are_refused_when_compiled_code_runs(distance, length, f_number, message):
    made = eqx.filter_jit(lambda *a: thin_lens(focus_distance=a[0], focal_length=a[1], f_number=a[2]))
    with pytest.raises(RuntimeError, match=message):
        made(*(jax.numpy.asarray(a) for a in (distance, length, f_number)))
