"""Lens profiles: files, those that come along, from prescriptions, and lensfun's."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.geometry import Camera, look_at
from focusjax.lens import (
    DarkenedLens,
    LensProfile,
    ProfileError,
    ThinLens,
    lens_profile,
    load_lensfun,
    load_profile,
    profile_names,
    profile_of,
    profiled_lens,
    save_profile,
    thin_lens,
)
from focusjax.optics import lens_preset, opened_to, seidel_sums

TEXT = """
title = "Mine"
focal_length_mm = 50
f_number = [2, 16]
focus_distance_m = [0.5, inf]
source = "measured by me"
[distortion]
heights_mm = [0, 10, 22]
percent = [0, -1, -3]
[illumination]
heights_mm = [0, 22]
share = [1, 0.5]
source = "my light meter"
"""
LENSFUN = """<lensdatabase version="1">
<lens><maker>M</maker><model>One 50mm</model><model lang="de">Eins</model><cropfactor>1.5</cropfactor>
<calibration><distortion model="ptlens" focal="50" a="0.01" b="-0.03" c="0.005"/>
<tca model="poly3" focal="50" vr="1.0002" br="0.0001" vb="0.9996"/>
<vignetting model="pa" focal="50" aperture="2" distance="1000" k1="-0.9" k2="0.5" k3="-0.2"/>
<vignetting model="pa" focal="50" aperture="4" distance="1000" k1="-0.3" k2="0.1" k3="-0.05"/>
<vignetting model="pa" focal="50" aperture="2" distance="1" k1="-0.7" k2="0.3" k3="-0.1"/>
</calibration></lens>
<lens><model>Zoom 20-40mm</model><cropfactor>1</cropfactor>
<calibration><distortion model="poly3" focal="20" k1="-0.02"/>
<distortion model="poly3" focal="40" k1="0.01"/></calibration></lens>
<lens><model>Five</model><cropfactor>1</cropfactor><aspect-ratio>4:3</aspect-ratio>
<calibration><distortion model="poly5" focal="30" k1="-0.01" k2="0.002"/></calibration></lens>
<lens><model>Fish</model><calibration><distortion model="acm" focal="30" k1="-0.01"/></calibration></lens>
</lensdatabase>"""


def camera_of(focal_length: float) -> Camera:
    return look_at((0, 0, 0), (0, 0, -1), width=36, height=24, focal_length=focal_length)


def open_lens(focal_length: float = 0.05, f_number: float = 2.0, focus: float = 2.0) -> ThinLens:
    return thin_lens(focus_distance=focus, focal_length=focal_length, f_number=f_number)


@pytest.fixture
def written(tmp_path):
    def write(text: str):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", profile_names())
def test_profiles_that_come_along_say_where_each_number_is_from(name: str, tmp_path):
    profile = lens_profile(name)
    tables = {table for table, _ in profile.curves()} | {"cats_eyes"}
    assert {table for table, source in profile.sources if "CREDITS.md" in source} == tables
    assert float(profile.f_number[0]) == pytest.approx(float(name.split("_f")[1]), rel=0.07)
    assert profile.f_number[1] == 16.0
    # A lens of the profile's own focal length reaches the corner of a full frame.
    length = float(profile.focal_length)
    thin = open_lens(length, profile.f_number[0], 50 * length)
    assert profiled_lens(thin, profile, camera_of(length)).channels()
    save_profile(tmp_path / "again.toml", profile)
    again = load_profile(tmp_path / "again.toml")
    # Six digits are written, and read as they are.
    jax.tree.map(np.testing.assert_array_equal, again, profile)


def test_a_profile_is_put_around_a_lens_and_scaled_to_its_camera(written):
    profile = load_profile(written(TEXT))
    lens = profiled_lens(open_lens(0.1), profile, camera_of(0.1))
    assert isinstance(lens, DarkenedLens)
    assert dict(profile.sources) == {"distortion": "measured by me", "illumination": "my light meter"}
    # At 10 mm from the axis, which is at 5 mm of the lens as it was measured.
    ray = lens.ray(camera_of(0.1), jnp.array([28.0, 12.0]), jnp.zeros(2))
    share = float(profile.distortion(jnp.array(0.005)))
    np.testing.assert_allclose(ray.a, [18.0 + 10.0 / (1.0 + share), 12.0])
    assert float(ray.weight) == pytest.approx(1.0 - 0.5 * 5 / 22)
    bare = LensProfile("none", jnp.array(0.05), (1.0, 22.0), (0.1, np.inf))
    assert profiled_lens(thin := open_lens(), bare, camera_of(0.05)) is thin


def test_a_short_table_is_gone_beyond_only_on_request(written):
    profile = load_profile(written(TEXT.replace("heights_mm = [0, 10, 22]", "heights_mm = [0, 10, 20]")))
    message = (
        "the table distortion of Mine reaches 20.00 mm from the axis, and the picture's farthest corner is"
        " 21.63 mm away; add the 1.63 mm that are missing, or ask for extrapolation"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        profiled_lens(open_lens(), profile, camera_of(0.05))
    lens = profiled_lens(open_lens(), profile, camera_of(0.05), extrapolate=True)
    ray = lens.ray(camera_of(0.05), jnp.array([36.0, 24.0]), jnp.zeros(2))
    corner = -0.03 - 0.002 * (np.hypot(18, 12) - 20)
    np.testing.assert_allclose(ray.a[0], 18 + 18 / (1 + corner), rtol=1e-6)


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        (open_lens(f_number=1.4), "the lens is at f/1.4, and Mine goes from f/2 to f/16"),
        (
            open_lens(focus=0.3),
            "the focus distance is 0.3 m, and Mine at this focal length focuses from 0.5 m",
        ),
    ],
)
def test_what_is_beyond_a_profiles_ranges_is_refused(written, lens: ThinLens, message: str):
    with pytest.raises(ValueError, match=message):
        profiled_lens(lens, load_profile(written(TEXT)), camera_of(0.05))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[distortion]", "[distortion", "is no TOML: .*at line 7"),
        ("percent", "per_cent", "unknown key distortion.per_cent; did you mean 'percent'"),
        ("[0, -1, -3]", "[0, -1]", "the table distortion.percent has 3 heights and 2 values"),
        ("[0, -1, -3]", '[0, "a", 1]', "distortion.percent is .*; expected an array of numbers"),
        ("[0, 10, 22]", "[0, 22, 10]", "the table distortion.percent has heights .*; expected rising ones"),
        ('source = "measured by me"', "", "distortion has no source; say where"),
        ("focal_length_mm = 50", "focal_length_mm = -1", "focal_length_mm is -1; expected a number"),
        ("[2, 16]", "[16, 2]", r"f_number is \[16, 2\]; expected two positive numbers, the smaller first"),
        ('title = "Mine"', "", "title is missing"),
        (
            "[illumination]",
            "[sagittal_focus]\nheights_mm = [0, 22]\ndioptres = [0.1, 0]\n[illumination]",
            "sagittal_focus starts with 0.1 and tangential_focus with 0 dioptres",
        ),
    ],
)
def test_malformed_profiles_are_refused_by_file_and_key(written, old: str, new: str, message: str):
    path = written(TEXT.replace(old, new, 1))
    with pytest.raises(ProfileError, match=message) as caught:
        load_profile(path)
    assert str(path) in str(caught.value)


def test_a_prescriptions_tables_agree_with_third_order_theory():
    """Of rays near the axis of a small opening; the sums are those that Optiland confirms (tests/optics)."""
    lens = opened_to(lens_preset("gauss_jp62087922_f1.8_1987"), 8.0)
    fit = profile_of(lens, focus_distance=np.inf, heights=5, reach=0.004, spectral=False, vignetting=False)
    profile = fit.profile
    focal, radius = float(profile.focal_length), float(profile.focal_length) / 16.0
    tangent = 0.004 / focal
    waves = seidel_sums(lens, field=float(np.arctan(tangent))).wavefront()
    sagittal, tangential = (np.asarray(curve.values) for curve in (profile.sagittal, profile.tangential))
    share = np.asarray(profile.distortion.values)
    found = {
        "W220": 0.5 * radius**2 * (sagittal[-1] - sagittal[0]),
        "W222": 0.5 * radius**2 * (tangential[-1] - sagittal[-1]),
        "W040": 0.25 * radius**2 * float(profile.spherical.values[0]),
        "W131": float(profile.coma.values[-1]) * radius / focal,
        "W311": -(share[-1] - share[0]) * tangent * radius,
    }
    for name, value in found.items():
        # Observed: 0.94 to 1.01 of it; the rest is of higher order.
        assert value == pytest.approx(1e-3 * float(waves[name]), rel=0.08)
    # Observed: 0.004 to 0.015.
    assert (fit.rms < 0.03 * fit.ideal_rms).all()


def test_lensfun_models_say_where_light_lands(tmp_path):
    """In halves of the sensor's short side, at the radius that an ideal lens would give it."""
    path = tmp_path / "db.xml"
    path.write_text(LENSFUN)
    crop = load_lensfun(path, "One", focal_length=0.05)
    assert crop.title == "One 50mm"
    r, unit = 1.2, 0.012 / 1.5
    axis = 1 - 0.01 + 0.03 - 0.005
    landed = r * (axis + 0.005 * r - 0.03 * r**2 + 0.01 * r**3) / axis
    # Between heights it is a cubic.
    assert float(crop.distortion(jnp.array(landed * unit))) == pytest.approx(landed / r - 1, abs=2e-5)
    assert float(crop.distortion.heights[-1]) == pytest.approx(np.hypot(18, 12) * 1e-3 / 1.5)
    red, green, blue = (float(curve(jnp.array(r * unit))) for curve in crop.lateral_colour)
    assert red == pytest.approx((0.0002 + 0.0001 * r**2) * r * unit, rel=1e-3)
    assert (green, blue) == (0.0, pytest.approx(-0.0004 * r * unit, rel=1e-3))
    # Half-way in focal length, half-way in the coefficient.
    zoom = load_lensfun(path, "zoom", focal_length=0.03)
    ratio = (1.005 - 0.005 * 1.0) / 1.005
    assert float(zoom.distortion(jnp.array(0.012 * ratio))) == pytest.approx(ratio - 1, abs=2e-5)
    five = load_lensfun(path, "Five", focal_length=0.03)
    ratio, half = 1 - 0.01 + 0.002, 0.5 * np.hypot(36, 24) * 1e-3 * 3 / 5
    assert float(five.distortion(jnp.array(half * ratio))) == pytest.approx(ratio - 1, abs=2e-5)
    assert profiled_lens(open_lens(0.03), five, camera_of(0.03)).channels() == ()


@pytest.mark.parametrize(
    ("aperture", "distance", "shares"),
    [
        (2.0, 1000.0, (0.8581685628621223, 0.5502021426550813, 0.399999961853031)),
        (2.8, 10.0, (0.9181119479100075, 0.7250389005998596, 0.6243987490004427)),
        (4.0, 1.0, (0.9507634741516598, 0.8234977090890064, 0.7498128732144744)),
    ],
)
def test_lensfun_vignettings_are_those_that_lensfun_finds(tmp_path, aperture, distance, shares):
    """Half-way to the middle of the right edge, there, and in the corner of 601 x 401 pixels.

    One over what lensfun 0.3.4 multiplies a white picture with (`scripts/make_lensfun_reference.py`).
    """
    path = tmp_path / "db.xml"
    path.write_text(LENSFUN)
    profile = load_lensfun(path, "One", focal_length=0.05, aperture=aperture, focus_distance=distance)
    corner = float(profile.illumination.heights[-1])
    assert corner == pytest.approx(np.hypot(18, 12) * 1e-3 / 1.5)
    heights = corner * np.array([150.0, 300.0, np.hypot(300, 200)]) / np.hypot(300, 200)
    # Observed 6e-6 off, between the table's heights.
    found = [float(profile.illumination(jnp.array(height))) for height in heights]
    np.testing.assert_allclose(found, shares, atol=2e-5)
    assert ("illumination", "lensfun file db.xml") in profile.sources
    made = profiled_lens(open_lens(f_number=aperture), profile, camera_of(0.05), extrapolate=True)
    assert made.channels()
    assert load_lensfun(path, "One", focal_length=0.05).illumination is None
    assert load_lensfun(path, "Zoom", focal_length=0.03, aperture=2).illumination is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'k1="-0.3"',
            'k1="dark"',
            "One 50mm: vignetting k1 is 'dark', in <vignetting .*aperture='4'.*expected a",
        ),
        (
            'aperture="4"',
            "",
            "has <vignetting .*k1='-0.3'.*>, without an aperture and a distance above 0; mend",
        ),
        (
            'model="pa" focal="50" aperture="4"',
            'model="acm" focal="50"',
            "by the model 'acm', in <vign.*expected pa",
        ),
        (
            'k3="-0.2"',
            'k3="-0.9"',
            "vignetting near f/2 that leaves -0.3 of the light, below 0; its k1, k2, k3 are",
        ),
        ('vr="1.0002"', 'vr="red"', "tca vr is 'red', in <tca .*expected a number"),
        ('br="0.0001"', 'br="1e39"', r"tca br is '1e39', in <tca .*a number from -1e\+06 to 1e\+06"),
    ],
)
def test_lensfun_elements_that_make_no_sense_are_named(tmp_path, old, new, message):
    path = tmp_path / "db.xml"
    path.write_text(LENSFUN.replace(old, new))
    with pytest.raises(ProfileError, match=message) as caught:
        load_lensfun(path, "One", focal_length=0.05, aperture=2.0, focus_distance=1000.0)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "focal_length", "message"),
    [
        ("Two", 0.05, "has no lens 'Two'; it starts with One 50mm; Zoom"),
        ("mm", 0.05, "2 lenses are called 'mm'"),
        ("One", 0.085, "was measured at 50 mm, and the camera's focal length is 85 mm"),
        ("Fish", 0.03, "has distortion by the model 'acm'; expected poly3, poly5 or ptlens"),
    ],
)
def test_lensfun_files_that_do_not_help_are_refused(tmp_path, name, focal_length, message):
    path = tmp_path / "db.xml"
    path.write_text(LENSFUN)
    with pytest.raises(ProfileError, match=message):
        load_lensfun(path, name, focal_length=focal_length)
    with pytest.raises(ProfileError, match=r"no vignetting that was measured near f/0.8 and 1000 m"):
        load_lensfun(path, "One", focal_length=0.05, aperture=0.8, focus_distance=1000.0)
    path.write_text("<lens>")
    with pytest.raises(ProfileError, match="cannot be read"):
        load_lensfun(path, name, focal_length=focal_length)


def test_a_profiles_tables_can_be_differentiated_by():
    """The corner's place by its distortion, through scaling and wrapping."""
    profile, camera = lens_profile("triplet_f4"), camera_of(0.05)
    thin = open_lens(f_number=4.0)

    @jax.value_and_grad
    def place(values):
        distortion = dataclasses.replace(profile.distortion, values=values)
        moved = LensProfile("one", profile.focal_length, (4.0, 16.0), (0.1, np.inf), distortion)
        lens = profiled_lens(thin, moved, camera)
        (term,) = lens.aberrations
        return term.offset(camera, jnp.array([36.0, 24.0]), jnp.zeros(2), jnp.zeros(2))[0]

    values = profile.distortion.values
    slopes = place(values)[1]
    step = 1e-7 * jax.random.normal(jax.random.key(0), values.shape)
    ahead, back = (float(place(values + sign * step)[0]) for sign in (1, -1))
    assert float(slopes @ step) == pytest.approx(0.5 * (ahead - back), rel=1e-5)
    assert 1 < np.count_nonzero(slopes) <= 4
