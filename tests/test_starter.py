"""`focusjax new`, `keys` and `schema`: what a newcomer meets first."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import build_camera, build_lens, build_objects, config_keys, json_schema, load_config

ROOT = Path(__file__).parents[1]


def call(*words):
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "200"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("new") / "two" / "my-first picture"
    status, printed, complaints = call("new", folder)
    assert (status, complaints) == (0, "")
    assert f"focusjax run {folder}" in printed
    return folder


def test_a_new_folder_has_all_that_its_config_names(made):
    names = ["bulbs.ply", "floor.obj", "focusjax.schema.json", "my-first picture.toml", "spot.glb"]
    assert sorted(path.name for path in made.iterdir()) == names
    config = load_config(made / "my-first picture.toml")
    assert config.title == "My first picture"
    camera = build_camera(config)
    build_lens(config, camera, solved=True)
    assert len(build_objects(config)) == len(config.scene.objects)


def test_its_first_line_leads_editors_to_the_schema(made):
    first = (made / "my-first picture.toml").read_text().splitlines()[0]
    schema = json.loads((made / re.fullmatch(r"#:schema (\S+)", first)[1]).read_text())
    assert schema == json_schema()


def test_the_wish_that_is_commented_out_is_one(made, tmp_path):
    text = (made / "my-first picture.toml").read_text()
    begun, rest = text.split("# [[focus]]\n")
    ours, after = rest.split("\n\n", 1)
    lines = [line.removeprefix("# ") for line in ours.splitlines()]
    whole = made / "more.toml"
    whole.write_text("\n".join([begun, "[[focus]]", *lines, "", after]))
    assert [wish.name for wish in load_config(whole).focus] == ["Spot's eyes", "lights", "calf in front"]
    whole.unlink()


def test_slips_in_the_configs_path_are_pointed_at(made):
    status, _, complaint = call("run", made / "my first picture.toml")
    assert (status, complaint.rpartition("; ")[2]) == (2, f"did you mean {made / 'my-first picture.toml'}?\n")
    status, _, complaint = call("run", made)
    expected = f"{made}: is a folder; name a config file in it, such as {made / 'my-first picture.toml'}"
    assert status == 2
    assert expected in complaint


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("here", "here is there already, and nothing is overwritten"), ("a.toml", "expected one such as")],
)
def test_nothing_is_overwritten(tmp_path, monkeypatch, name, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").mkdir()
    status, printed, complaint = call("new", name)
    assert (status, printed) == (2, "")
    assert sentence in complaint
    assert [path.name for path in tmp_path.rglob("*")] == ["here"]


def test_the_meshes_are_those_of_the_configs():
    """The same files, whose origin and licence configs/meshes/CREDITS.md says."""
    starter, meshes = ROOT / "focusjax" / "starter", ROOT / "configs" / "meshes"
    assert (starter / "spot.glb").read_bytes() == (meshes / "spot.glb").read_bytes()
    assert (starter / "bulbs.ply").read_bytes() == (meshes / "still_life" / "bulbs.ply").read_bytes()


def test_keys_are_lines_with_tabs_for_other_programs():
    status, printed, _ = call("keys", "solve")
    rows = [line.split("\t") for line in printed.splitlines()]
    assert status == 0
    assert rows[0] == ["key", "type", "unit", "default", "meaning"]
    assert [row[0] for row in rows[1:]] == [key.path for key in config_keys("solve")]
    assert [
        "solve.f_number_min",
        "number > 0",
        "",
        "1",
        "the lens's widest f-number, for example 1.4",
    ] in rows
    status, _, complaint = call("keys", "solv")
    assert (status, complaint) == (
        2,
        "focusjax: no table or key of a config is called solv; did you mean 'solve'?\n",
    )


def test_the_schema_goes_to_a_file_or_is_printed(tmp_path):
    assert call("schema", "--out", tmp_path / "s.json")[:2] == (0, "")
    assert json.loads((tmp_path / "s.json").read_text()) == json_schema()
    assert json.loads(call("schema")[1]) == json_schema()
