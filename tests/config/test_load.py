"""Every way a config can be wrong, each with the sentence a person gets."""

import math

import pytest

from focusjax.config import ConfigError, RenderTable, build_solve_options, load_config
from focusjax.solvers import JaxoptLBFGSB

GOOD = """
[scene]
unlit = true
[[scene.objects]]
file = "a.ply"
[camera]
position = [0, 0, 5]
look_at = [0, 0, 0]
focal_length_mm = 50
resolution = [64, 48]
[lens]
f_number = 2.8
focus_distance_m = inf
[[focus]]
pixel = [3, 4]
sharp = true
"""


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "good.toml"
    file.write_text(GOOD)
    return file


def message(path, *overrides):
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    return str(caught.value).replace(f"{path}: ", "")


def test_a_good_config(path):
    config = load_config(path)
    assert config.source == path
    assert config.camera.resolution == (64, 48)
    assert math.isinf(config.lens.focus_distance_m)
    assert config.focus[0].weight == 1.0


def test_the_message_starts_with_the_file(path):
    with pytest.raises(ConfigError) as caught:
        load_config(path, ["foo=1"])
    assert str(caught.value).startswith(f"{path}: unknown key foo")


def test_a_layer_has_no_more_samples_than_a_picture(path):
    size, fine = "camera.resolution=[8000, 6000]", "render.supersampling=2"
    assert load_config(path, [size]).camera.resolution == (8000, 6000)
    assert (
        "has camera.resolution = [8000, 6000] and render.supersampling = 2, which is 192 million samples a"
        " layer; expected at most 134 million, so lower one of them"
    ) in message(path, size, fine)


def test_overrides_reach_tables_lists_and_new_tables(path):
    config = load_config(
        path,
        [
            "focus.0.weight=2",
            "render.rays = 8",
            "camera.resolution=[32, 24]",
            "title=Two words",
            "render.rays=4",
        ],
    )
    assert config.focus[0].weight == 2.0
    assert config.render.rays == 4
    assert config.camera.resolution == (32, 24)
    assert config.title == "Two words"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("camera.focal_length=50", "unknown key camera.focal_length; did you mean focal_length_mm?"),
        ("lens.f_number=0", "lens.f_number is 0; expected a number above 0; give the f-number"),
        ("lens.f_number=-2", "lens.f_number is -2; expected a number above 0"),
        ("lens.f_number=nan", "lens.f_number is NaN; expected a finite number"),
        ("camera.focal_length_mm=50 mm", 'camera.focal_length_mm is "50 mm"; expected a number; give'),
        ("camera.focal_length_mm=0", "camera.focal_length_mm is 0; expected a number of at least 0.1"),
        ("camera.focal_length_mm=0.05", "camera.focal_length_mm is 0.05; expected a number of at least 0.1"),
        ("camera.resolution=[0, 48]", "camera.resolution.0 is 0; expected a number of at least 1; give the"),
        (
            "camera.resolution=[30000, 30000]",
            "camera.resolution is [30000, 30000], which is 900 million pixels; expected at most 134 million,"
            " so give a smaller picture",
        ),
        ("scene.objects.0.emission=1e38", "scene.objects.0.emission is 1e+38; expected a number of at most"),
        ("scene.objects.0.emission=[0, 1e20, 0]", "scene.objects.0.emission.1 is 1e+20; expected a number"),
        ("scene.ambient=1e16", "scene.ambient is 1e+16; expected a number of at most 1e+15; give light"),
        ("camera.resolution=[64]", "camera.resolution.1 is missing; give the picture's [width, height]"),
        ("camera.resolution=64", "camera.resolution is 64; expected an array in brackets"),
        ("camera.resolution=[64.5, 48]", "camera.resolution.0 is 64.5; expected a whole number"),
        ("camera.field_of_view_deg=40", "camera needs exactly one of focal_length_mm and field_of_view_deg"),
        ("camera.matrix=[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "camera has a matrix and also position"),
        ("lens.aperture_radius_mm=4", "lens needs exactly one of f_number and aperture_radius_mm"),
        ("lens.focus_distance_m=0", "lens.focus_distance_m is 0; expected a number above 0; give the focus"),
        ("lens.tilt_deg=50", "lens.tilt_deg is 50; expected a number of at most 45; give the lens's"),
        ("lens.swing_deg=left", 'lens.swing_deg is "left"; expected a number; give the lens'),
        ("lens.tilt_degrees=5", "unknown key lens.tilt_degrees; did you mean tilt_deg?"),
        ("camera.rise_mm=inf", "camera.rise_mm is Infinity; expected a finite number; give how far in mm"),
        ("lens.aperture=[1, 2]", "lens.aperture is [1, 2]; expected a table; give the opening, for example"),
        ("lens.aperture.shape=polygon", "lens.aperture.blades is missing; give the number of"),
        ("lens.aperture.shape=star", 'lens.aperture has shape = "star"; give the opening, for example'),
        ("focus.0.blur_px=3", "focus.0 needs exactly one of sharp = true, blur_px, at_most_px"),
        ("focus.0.object=a", "focus.0 needs exactly one of pixel, point, direction, triangle, object, mask"),
        ("focus.0.sharp=false", "focus.0.sharp is false; expected true; give sharp = true, or a blur"),
        ("focus.0.weight=-1", "focus.0.weight is -1; expected a number of at least 0; give how much"),
        ("focus.0.pixels=[1, 2]", "unknown key focus.0.pixels; did you mean pixel?"),
        ("focus.0.triangle=3", "focus.0 needs exactly one of pixel, point, direction, triangle, object"),
        ("solve.f_number_min=40", "solve has f_number_min = 40, which is not below f_number_max = 32; swap"),
        ("solve.max_focus_distance_m=-1", "solve.max_focus_distance_m is -1; expected a number above 0"),
        ("solve.free=['focus', 'focus']", "solve has free = ['focus', 'focus']; name each setting once"),
        ("solve.solver='newton'", "solve.solver is \"newton\"; expected 'levenberg-marquardt', 'dogleg'"),
        ("solve.free=['slide']", "solve.free.0 is \"slide\"; expected 'focus', 'f_number', 'tilt'"),
        ("solve.free=['focal_length']", "solve has focal_length free without a range; give focal_length_min"),
        ("solve={rise_min_mm=5, rise_max_mm=-5}", "solve has rise_min_mm = 5, which is not below rise_max"),
        ("solve.prior.rise={length_mm=1, sigma_mm=1}", "solve has prior.rise, but rise is not free; remove"),
        ("focus.0={depth_m=[1, 2], in_frame_px=5}", "focus.0 has depth_m, which is nowhere in the picture"),
        ("focus.0.shown_at=[1, 2]", "focus.0 needs exactly one of sharp = true, blur_px, at_most_px"),
        ("focus.0={pixel=[3, 4], in_frame_px=-5}", "focus.0.in_frame_px is -5; expected a number of at"),
        ("solve.tilt_min_deg=50", "solve has tilt_min_deg = 50, which is not below tilt_max_deg = 45; swap"),
        ("solve.prior.tilt={angle_deg=1, sigma_deg=1}", "solve has prior.tilt, but tilt is not free; remove"),
        ("focus.0.same_blur_as=x", "focus.0 needs exactly one of sharp = true, blur_px, at_most_px"),
        ("focus.0.tolerance_mm=-1", "focus.0.tolerance_mm is -1; expected a number of at least 0; give"),
        ("scene.background={kind='constant', color=1.0}", "unknown key scene.background.color; did you mean"),
        ("scene.background.kind=sky", 'scene.background has kind = "sky"; give a background of kind'),
        ("scene.background={colour=[1,1,1]}", "scene.background has no kind; give a background of kind"),
        ("scene.objects=[]", "scene.objects is []; expected at least 1 entries; give at least one"),
        ("scene.objects.0.emission=[1,-1,1]", "scene.objects.0.emission.1 is -1; expected a number of"),
        ("scene.objects.0.colour=[2,0,0]", "scene.objects.0.colour.0 is 2; expected a number of at"),
        ("scene.objects.0.reflectance=2", "scene.objects.0.reflectance is 2; expected a number of at most 1"),
        ("scene.objects.0.scale=big", 'scene.objects.0.scale is "big"; expected a number; give one factor'),
        ("scene.lights=[{kind='spot'}]", 'scene.lights.0 has kind = "spot"; give lights of kind'),
        ("scene.ambient=0.5", "scene is unlit and has lights; remove unlit, or the lights"),
        ("scene.unlit=false", "scene has no light; add a [[scene.lights]] table, ambient light, or unlit"),
        ("scene.unlit=1", "scene.unlit is 1; expected true or false"),
        ("render.quality=best", "render quality is 'best'; expected 10 to 80 dB, such as '40 dB', or"),
        ("render.rays=0", "render.rays is 0; expected a number of at least 1; give lens rays"),
        (
            "render.pixel_filter=cubic",
            "render.pixel_filter is \"cubic\"; expected 'box', 'tent' or 'gaussian'",
        ),
        ("render.view_dependent=1", "render.view_dependent is 1; expected true or false; give true to let"),
        ("render.png_bits=12", "render.png_bits is 12; expected 8 or 16; give 8 or"),
        ("title=3", "title is 3; expected text in quotes; give a title for the report"),
        ("xyz=3", "unknown key xyz; known keys here are title, scene, camera, lens"),
    ],
)  # fmt: skip
def test_bad_values(path, override, expected):
    assert message(path, override).startswith(expected)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("rays", "--set rays: expected key=value, for example render.rays=16"),
        ("=3", "--set =3: expected key=value, for example render.rays=16"),
        ("focus.7.weight=1", "--set focus.7.weight=1: focus has 1 entries; expected a number from 0 to 0"),
        (
            "focus.eye.weight=1",
            "--set focus.eye.weight=1: focus has 1 entries; expected a number from 0 to 0",
        ),
        (
            "lens.f_number.x=1",
            "--set lens.f_number.x=1: lens.f_number is a value, not a table; shorten the key",
        ),
    ],
)
def test_bad_overrides(path, override, expected):
    assert message(path, override).startswith(expected)


def test_unreadable_files(tmp_path):
    assert "there is no such config file" in message(tmp_path / "missing.toml")
    assert "is a folder; name a config file in it" in message(tmp_path)
    (tmp_path / "broken.toml").write_text("[scene\n")
    assert "this is not valid TOML" in message(tmp_path / "broken.toml")
    (tmp_path / "wide.toml").write_text('title = "boxes"\n', encoding="utf-16")
    assert "this is not text in UTF-8 (invalid start byte); save it" in message(tmp_path / "wide.toml")
    (tmp_path / "empty.toml").write_text("")
    assert message(tmp_path / "empty.toml") == "scene is missing; give a [scene] table"


def test_a_root_that_is_not_there_is_named(path):
    with pytest.raises(ConfigError, match=r"root nowhere is not a folder; name the one below which"):
        load_config(path, root="nowhere")


def test_the_solver_is_the_solves(path):
    assert "solver" not in build_solve_options(load_config(path))
    options = build_solve_options(load_config(path, ["solve.solver=jaxopt"]))
    assert isinstance(options["solver"], JaxoptLBFGSB)


def test_limits_of_what_is_not_free_are_reported(path):
    changes = ["solve.free=['focus']", "solve.tilt_max_deg=8", "solve.keep_field_of_view=true"]
    with pytest.warns(UserWarning, match="limits nothing") as caught:
        options = build_solve_options(load_config(path, changes))
    messages = " ".join(str(each.message) for each in caught)
    assert (
        "solve.tilt_max_deg limits nothing, since tilt is not free; add 'tilt' to solve.free, or" in messages
    )
    assert "solve.keep_field_of_view limits nothing, since focal_length is not free" in messages
    assert set(options) == {"free", "max_focus_distance"}


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, 1),
        ({"quality": "draft"}, 1),
        ({"quality": 40}, 1),
        ({"quality": "reference"}, 2),
        ({"quality": "draft", "supersampling": 3}, 3),
    ],
)
def test_a_high_quality_takes_more_layer_samples(values: dict, expected: int):
    assert RenderTable.model_validate(values).supersampling == expected
