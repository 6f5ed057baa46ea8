"""`focusjax export` solves and writes, and says what is wrong in one line."""

import json

import pytest
from boxes_config import write_boxes
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.exchange import TARGETS

SHOT = """
[shot]
frames = 3
[[shot.camera]]
frame = 1
position = [0, 0, 0]
[[shot.camera]]
frame = 3
position = [0.1, 0, 0]
"""


def export(*words):
    return CliRunner().invoke(app, ["export", *map(str, words)])


@pytest.mark.parametrize("to", TARGETS)
def test_the_solved_camera_is_written(tmp_path, to):
    config, file = write_boxes(tmp_path), tmp_path / f"solved{TARGETS[to].suffix}"
    done = export(config, "--to", to, "--out", file)
    assert done.exit_code == 0, done.output
    assert f"Camera: {file}" in done.output.replace("\n", "")
    assert file.stat().st_size > 100


def test_wishes_are_solved_first(tmp_path):
    config, file = write_boxes(tmp_path), tmp_path / "solved.gltf"
    assert export(config, "--to", "gltf", "--out", file).exit_code == 0
    solved = json.loads(file.read_text())["cameras"][0]["extras"]["focusjax"]
    # The front of the near box, and not the 4 m that the lens starts from.
    assert solved["focus_distance_m"] == pytest.approx(1.75, rel=1e-4)
    assert export(config, "--to", "gltf", "--out", file, "--set", "focus=[]").exit_code == 0
    kept = json.loads(file.read_text())["cameras"][0]["extras"]["focusjax"]
    assert kept["focus_distance_m"] == pytest.approx(4.0)


def test_a_shot_is_keyframed(tmp_path):
    config, file = write_boxes(tmp_path), tmp_path / "shot.usda"
    config.write_text(config.read_text() + SHOT)
    done = export(config, "--to", "usd", "--shot", "--out", file, "--set", "solve.free=['focus']")
    assert done.exit_code == 0, done.output
    text = file.read_text()
    assert "endTimeCode = 3" in text
    assert "matrix4d xformOp:transform.timeSamples" in text
    assert text.count("float focusDistance") == 1


def test_a_stage_has_the_units_axes_and_name_asked_for(tmp_path):
    config, file = write_boxes(tmp_path), tmp_path / "stage.usda"
    words = ["--metres-per-unit", 0.01, "--up-axis", "Z", "--name", "Second Unit"]
    done = export(config, "--to", "usd", "--out", file, *words)
    assert done.exit_code == 0, done.output
    text = file.read_text()
    assert "metersPerUnit = 0.01" in text
    assert 'upAxis = "Z"' in text
    assert 'def Camera "Second_Unit"' in text


def test_approximations_are_reported(tmp_path):
    config, file = write_boxes(tmp_path), tmp_path / "c.xml"
    turned = ["--set", "lens.swing_deg=3"]
    refused = export(config, "--to", "mitsuba", "--out", file, *turned)
    assert refused.exit_code == 2
    assert "Mitsuba cannot express a lens turned against the sensor" in refused.output
    assert not file.exists()
    result = export(config, "--to", "mitsuba", "--out", file, "--approximate", *turned)
    assert result.exit_code == 0
    assert "Approximated: the lens stands upright" in result.output
    assert "px in diameter." in result.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "maya"], "there is no target 'maya'; expected usd, blender, mitsuba, pbrt, gltf"),
        (["--to", "usd", "--metres-per-unit", "0"], "metres_per_unit is 0.0; expected a length above 0"),
        (["--to", "usd", "--up-axis", "X"], "up_axis is 'X'; expected 'Y' or 'Z'"),
        (["--to", "blender", "--up-axis", "Z"], "up_axis is given for the target 'blender'"),
        (["--to", "usd", "--shot"], "there is no [shot] table"),
        (["--to", "usd", "--out", "c.usdc"], "c.usdc does not end in .usda"),
    ],
)
def test_bad_usage(tmp_path, words, message):
    done = export(write_boxes(tmp_path), *words)
    assert done.exit_code == 2
    assert message in done.output.replace("\n", "")
