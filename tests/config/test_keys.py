"""What a config may hold, said in words and as a schema: both come from the models that check it."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

from focusjax.config import ConfigError, config_keys, json_schema, load_config

ROOT = Path(__file__).parents[2]
CONFIGS = sorted([*(ROOT / "configs").glob("*.toml"), ROOT / "focusjax" / "starter" / "starter.toml"])


@pytest.fixture(scope="module")
def schema():
    return jsonschema.Draft4Validator(json_schema())


def complaints(schema, text):
    return [error.message for error in schema.iter_errors(tomllib.loads(text))]


def test_every_key_has_a_type_and_a_meaning():
    keys = config_keys()
    assert len(keys) > 200
    for key in keys:
        assert key.type, key.path
        assert key.meaning, key.path
        assert "Annotated" not in key.type, key.path
        assert key.about.endswith(".") or not key.table, key.path


# By hand, from what the code does with them.
@pytest.mark.parametrize(
    ("path", "type_", "unit", "default", "required"),
    [
        ("lens.focus_distance_m", "number > 0", "m", "", False),
        ("camera.resolution", "array of 2: whole number from 1 to 32768", "px", "", True),
        ("camera.from", "text", "", "", False),
        ("shot.frames", "whole number from 1 to 100000", "", "", False),
        ("camera.position", "array of 3: number", "m", "", False),
        ("render.rays", "whole number from 1 to 65536", "", "64", False),
        ("render.exposure", "number", "stops", "0", False),
        ("solve.max_focus_distance_m", "number > 0", "m", "inf", False),
        ("solve.tilt_min_deg", "number > -90, < 90", "°", "-45", False),
        ("exposure.time", 'number > 0 or text such as "1/60"', "s", "", False),
        ("render.png_bits", "8 or 16", "", "8", False),
        ("render.quality", "text or number", "", "", False),
        ("focus", "tables", "", "[]", False),
        ("lens.colour.focus_offset", "array of 3: number", "1/m", "[0, 0, 0]", False),
        ("solve.prior.focus.sigma_per_m", "number > 0", "1/m", "", True),
    ],
)
def test_keys_as_they_are(path, type_, unit, default, required):
    key = next(key for key in config_keys() if key.path == path)
    assert (key.type, key.unit, key.default, key.required) == (type_, unit, default, required)


def test_a_table_holds_its_own_and_those_in_it():
    assert {key.table for key in config_keys("[lens.focal_surface]")} == {
        "lens.focal_surface", "lens.focal_surface.points", "lens.focal_surface.kernel",
    }  # fmt: skip
    assert {key.variant for key in config_keys("scene.lights")} == {
        'kind = "directional"', 'kind = "point"',
    }  # fmt: skip
    assert config_keys("[[focus]]")[0].heading == "[[focus]]"


def test_a_slip_in_a_tables_name_is_pointed_at():
    with pytest.raises(ConfigError, match=r"no table or key .* is called rendr; did you mean 'render'\?"):
        config_keys("rendr")
    with pytest.raises(ConfigError, match=r"called 12345; there are scene, camera, lens"):
        config_keys("12345")


def test_the_schema_is_one(schema):
    jsonschema.Draft4Validator.check_schema(schema.schema)
    # What editors read is JSON, which has neither inf nor nan.
    assert json.loads(json.dumps(schema.schema, allow_nan=False)) == schema.schema


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_configs_fit_the_schema(schema, path):
    assert complaints(schema, path.read_text()) == []


BEYOND = """
[scene]
photo = { file = "night.jpg" }
[lens]
f_number = 2
[exposure]
light_ev = 3
time = "1/60"
"""


def test_keys_that_come_from_elsewhere_may_be_left_out(schema):
    assert complaints(schema, BEYOND) == []
    # Of a stage, whose frames they are.
    assert complaints(schema, BEYOND + "[shot]\n") == []


def test_keys_have_the_names_that_a_config_has():
    (key,) = config_keys("camera.from")
    assert key.name == "from"
    assert not [key.path for key in config_keys() if key.name.endswith("_")]


SMALL = """
[scene]
ambient = 1
objects = [{ file = "a.ply" }]
[camera]
position = [0, 0, 1]
look_at = [0, 0, 0]
focal_length_mm = 50
resolution = [64, 48]
[lens]
f_number = 2.8
"""


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        ("f_number = 2.8", "f_nmber = 2.8"),
        ("f_number = 2.8", "f_number = 0"),
        ("f_number = 2.8", 'f_number = "2.8"'),
        ("resolution = [64, 48]", "resolution = [64]"),
        ("resolution = [64, 48]", "resolution = [64, 4.5]"),
        ("[lens]", '[lens]\naperture = { shape = "star" }'),
        ("[lens]", '[render]\npixel_filter = "bx"\n[lens]'),
    ],
)
def test_schema_and_models_refuse_the_same(schema, tmp_path, was, becomes):
    (tmp_path / "config.toml").write_text(SMALL)
    load_config(tmp_path / "config.toml")
    assert complaints(schema, SMALL) == []
    assert SMALL.count(was) == 1
    (tmp_path / "config.toml").write_text(SMALL.replace(was, becomes))
    with pytest.raises(ConfigError):
        load_config(tmp_path / "config.toml")
    assert complaints(schema, SMALL.replace(was, becomes))
