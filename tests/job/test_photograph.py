"""What `[exposure]` and `[film]` make of a run's picture, and what the report says of it."""

import json
import re

import imageio.v3 as iio
import numpy as np
import pytest
from boxes_config import write_boxes
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.io import load_exr

LIGHT = ["--set", "exposure.light_ev=10"]
HAND = ["--set", "exposure.time=1/250", "--set", "exposure.iso=400"]


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    return write_boxes(tmp_path_factory.mktemp("boxes"))


def rendered(boxes, folder, *options, command="render"):
    result = CliRunner().invoke(app, [command, str(boxes), *options, "--out", str(folder)])
    assert result.exit_code in (0, 3), result.output
    return " ".join(result.output.split()), json.loads((folder / "report.json").read_text())


@pytest.fixture(scope="module")
def plain(boxes, tmp_path_factory):
    """Without exposure and film: the folder and its report."""
    folder = tmp_path_factory.mktemp("plain")
    return folder, rendered(boxes, folder)[1]


def test_settings_are_chosen_and_reported(boxes, plain, tmp_path):
    output, report = rendered(boxes, tmp_path, *LIGHT)
    taken = report["exposure"]
    assert (taken["f_number"], taken["iso"], taken["limits"]) == (pytest.approx(2.0), 100.0, [])
    assert taken["chosen"] == ["time", "iso"]
    assert taken["stops_off"] == pytest.approx(0.0, abs=1e-6)
    # 50 mm focused on 4 m.
    assert taken["magnification"] == pytest.approx(0.05 / 3.95)
    assert taken["effective_f_number"] == pytest.approx(2 * 4 / 3.95)
    # The mean of the picture is brighter than the grey of 0.18 that light values are about.
    brighter = np.log2(taken["metered_radiance"] / 0.18)
    assert taken["exposure_value"] == pytest.approx(10 + brighter, abs=0.1)
    assert f"{taken['shutter']} at ISO 100, EV {taken['exposure_value']:.1f};" in output
    page = (tmp_path / "report.html").read_text()
    assert f"<dt>Shutter</dt><dd>{taken['shutter']}</dd>" in page
    # Radiance is what it was, and the display's picture is a grey world.
    before, after = (load_exr(folder / "image.exr")["G"] for folder in (plain[0], tmp_path))
    np.testing.assert_array_equal(before, after)
    light = (iio.imread(tmp_path / "image.png") / 255.0) ** 2.2
    assert 0.1 < light.mean() < 0.25


def test_what_is_absent_changes_nothing(plain):
    folder, report = plain
    assert report["exposure"] is None
    assert "develop" not in report["seconds"]
    assert "<dt>Shutter" not in (folder / "report.html").read_text()


def test_a_shutter_that_is_too_short_makes_the_picture_dark_and_says_so(boxes, tmp_path):
    dark = ("--set", "exposure.light_ev=2", "--set", "exposure.iso_max=800")
    output, report = rendered(boxes, tmp_path, *dark)
    off = report["exposure"]["stops_off"]
    assert off < -1
    sentence = f"The picture is {-off:.1f} stops too dark at the longest time and the highest ISO speed; f/"
    assert sentence in output
    assert sentence in (tmp_path / "report.html").read_text()
    right = float(re.search(r"speed; f/([0-9.]+) would be right", output)[1])
    assert right == pytest.approx(2.0 * 2 ** (off / 2), rel=0.03)


def test_film_is_developed_with_its_grain(boxes, plain, tmp_path):
    slide = ["--set", "film.preset=reversal"]
    rendered(boxes, tmp_path / "slide", *LIGHT, *HAND, *slide)
    rendered(boxes, tmp_path / "grain", *LIGHT, *HAND, *slide, "--set", "film.rms_granularity=30")
    rendered(boxes, tmp_path / "grey", *LIGHT, *HAND, "--set", "film.preset=black_and_white")
    pictures = {name: iio.imread(tmp_path / name / "image.png") for name in ("slide", "grain", "grey")}
    assert not np.array_equal(pictures["slide"], pictures["grain"])
    assert np.ptp(pictures["grey"], axis=-1).max() <= 1
    assert np.ptp(pictures["slide"], axis=-1).max() > 50
    # Without an exposure a radiance of 0.18 is grey.
    rendered(boxes, tmp_path / "alone", *slide)
    assert not np.array_equal(
        iio.imread(tmp_path / "alone" / "image.png"), iio.imread(plain[0] / "image.png")
    )


def test_depth_of_field_exposed_by_hand(boxes, tmp_path):
    """Aperture, time and speed from what is to be sharp, the light, and what a hand holds."""
    deep = boxes.with_name("deep.toml")
    text = boxes.read_text().replace("f_number = 2.0\nfocus_distance_m = 4.0", "")
    deep.write_text(text.replace("[lens]", "[lens]\nsharp_from_m = 2\nsharp_to_m = 4"))
    output, report = rendered(deep, tmp_path, "--set", "exposure.light_ev=8")
    taken, depth = report["exposure"], report["lens"]["depth_of_field"]
    assert (depth["near_m"], depth["far_m"]) == (pytest.approx(2.0), pytest.approx(4.0))
    assert "sharp from 2.00 m to 4.00 m" in output
    assert taken["f_number"] == pytest.approx(report["lens"]["f_number"])
    assert taken["time_s"] == pytest.approx(1 / 60)
    assert 100 < taken["iso"] < 6400
    assert taken["stops_off"] == pytest.approx(0.0, abs=1e-6)
    dim = ["--set", "exposure.light_ev=2", "--set", "exposure.priority=exposure"]
    output, report = rendered(deep, tmp_path, *dim)
    assert abs(report["exposure"]["stops_off"]) < 1e-3
    assert report["lens"]["f_number"] < taken["f_number"] / 2
    depth = report["lens"]["depth_of_field"]
    left = f"Focus gives way: at f/{report['lens']['f_number']:.2g} it is sharp from {depth['near_m']:.3g} to"
    assert left in output
    assert left in (tmp_path / "report.html").read_text()
    with pytest.raises(ConfigError, match="has one of sharp_from_m and sharp_to_m; give both"):
        load_config(boxes, ["lens.sharp_from_m=2"])
    with pytest.raises(ConfigError, match="which gives focus and f-number, and f_number; leave one out"):
        load_config(boxes, ["lens.sharp_from_m=2", "lens.sharp_to_m=4"])
    with pytest.raises(ConfigError, match="sharp_from_m = 5, which is not below sharp_to_m = 4"):
        load_config(deep, ["lens.sharp_from_m=5"])


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["exposure.time=0.5"], "exposure needs exactly one of light_ev and luminance_cd_m2"),
        (["exposure.light_ev=9", "exposure.luminance_cd_m2=9"], "needs exactly one of light_ev and"),
        (
            ["exposure.light_ev=9", "exposure.time=0"],
            "exposure.time is 0; expected a number above 0; give the",
        ),
        (["exposure.light_ev=9", "exposure.time=inf"], "exposure.time is Infinity; expected a finite number"),
        (["exposure.light_ev=9", "exposure.time='1/0'"], 'exposure.time is "1/0"; expected seconds, such as'),
        (["exposure.light_ev=9", "exposure.iso=0.2"], "exposure.iso is 0.2; expected a number of at least 1"),
        (
            ["exposure.light_ev=9", "exposure.iso=1e9"],
            "exposure.iso is 1000000000.0; expected a number of at",
        ),
        (
            ["exposure.light_ev=9", "exposure.iso=100", "exposure.iso_max=200"],
            "has iso_max, a limit to what is given anyway",
        ),
        (
            ["exposure.light_ev=9", "exposure.iso=100", "exposure.time=1", "exposure.meter=centre"],
            "has time, iso and meter, which only a chosen exposure has",
        ),
        (
            ["exposure.light_ev=9", "exposure.meter=centre", "exposure.zones=[{box = [0, 0, 2, 2]}]"],
            "has a meter and zones",
        ),
        (
            ["exposure.light_ev=9", "exposure.iso_min=400", "exposure.iso_max=200"],
            "iso_min = 400, which is above",
        ),
        (["exposure.light_ev=9", "render.exposure=1"], "use exposure.compensation instead"),
        (["exposure.light_ev=140"], "exposure.light_ev is 140; expected a number of at most 50"),
        (
            ["exposure.light_ev=9", "exposure.compensation=3000"],
            "exposure.compensation is 3000; expected a number of at most 50",
        ),
        (
            ["exposure.light_ev=9", "exposure.priority=focus", "solve.free=['focus']"],
            "has exposure.priority, but no f-number that may change; give lens.sharp_from_m",
        ),
        (["exposure.light_ev=9", "exposure.priority=both"], 'exposure.priority is "both"; expected'),
        (["film.preset=reversed"], "preset = \"reversed\", which is no film; did you mean 'reversal'?"),
        (["film.preset=negative", "film.curve=a.csv"], "has a preset and a curve"),
        (["film.paper=a.csv"], "has paper without a curve"),
        (["film.rms_granularity=8"], "a sensor has no grain"),
        (["film.preset=negative", "film.noise.full_well=100"], "has noise, but film has none"),
        (["film.noise.full_well=100"], "film.noise without an [exposure], whose speed it depends on"),
        (["film.kelvin=3200", "film.white_balance=grey_world"], "has kelvin and white_balance"),
        (["film.kelvin=500"], "film.kelvin is 500; expected a number of at least 2000"),
        (["film.white_balance=[1, 2]"], "has 2 gains as white_balance; give 3"),
        (
            ["lens.natural_falloff=true", "lens.falloff={heights_mm=[0, 30], shares=[1, 1]}"],
            "give one of them",
        ),
    ],
)
def test_tables_that_make_no_sense_are_refused(boxes, overrides, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_config(boxes, overrides)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["film.curve=none.csv"], "this curve cannot be read"),
        (["lens.aperture_radius_mm=0", "exposure.light_ev=9"], "exposure: the lens is a pinhole"),
        (
            ["exposure.light_ev=9", "exposure.zones=[{box = [30, 20, 20, 20]}]"],
            "not within the picture of 40 x 30",
        ),
        (
            ["lens.falloff={heights_mm=[0, 10], shares=[1, 0.8]}"],
            "farthest corner is 22.50 mm away; add the 12.50",
        ),
    ],
)
def test_what_turns_out_impossible_is_reported_in_a_sentence(boxes, tmp_path, options, message):
    given = [part for option in options for part in ("--set", option)]
    if "lens.aperture_radius_mm=0" in options:
        text = boxes.read_text().replace("f_number = 2.0\n", "")
        boxes = boxes.with_name("pinhole.toml")
        boxes.write_text(text)
    result = CliRunner().invoke(app, ["render", str(boxes), *given, "--out", str(tmp_path)])
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())


def test_vignetting_darkens_the_corners_of_the_picture_only(boxes, plain, tmp_path):
    options = ["--set", "lens.natural_falloff=true", "--set", "lens.hood={diameter_mm=50, length_mm=55}"]
    rendered(boxes, tmp_path, *options)
    before, after = (load_exr(folder / "image.exr")["G"] for folder in (plain[0], tmp_path))
    share = after / before
    assert share[14:16, 19:21] == pytest.approx(1.0, abs=0.01)
    assert share[0, 0] < 0.8 * np.cos(np.arctan(22.5 / 50)) ** 4
    np.testing.assert_array_equal(iio.imread(tmp_path / "pinhole.png"), iio.imread(plain[0] / "pinhole.png"))
