"""`focusjax bench speed-error` from outside: its files, its table, and the sentence for what goes wrong."""

import csv
import json
import re

import pytest
from complaints import complaints_in
from typer.testing import CliRunner

from focusjax.cli import app


def bench(*arguments):
    """The exit status, what was printed to stdout, and to stderr beside the progress."""
    words = ["bench", "speed-error", *(str(argument) for argument in arguments)]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, complaints_in(result.stderr, "Ball & <wall>")


@pytest.fixture(scope="module")
def finished(config_file, tmp_path_factory):
    """A comparison of the tracer with multilayer, which cannot be with one layer."""
    folder = tmp_path_factory.mktemp("comparison")
    status, printed, complaint = bench(
        config_file, "--out", folder / "out", "--size", "32x24", "--repeats", 1, "--cache", folder / "cache",
        "--reference", "raycast", "--reference-samples", 64,
        "--methods", "tracer-1=8", "--methods", "multilayer=1",
    )  # fmt: skip
    return folder, status, printed, complaint


def test_files_and_status(finished):
    folder, status, printed, complaint = finished
    # What could be measured is reported, what could not is an error.
    assert status == 1
    assert complaint == "focusjax: multilayer failed on ball_and_wall: layers is 1; expected at least 2\n"
    names = sorted(path.name for path in (folder / "out").iterdir())
    assert names == ["pareto.png", "report.html", "results.csv", "results.json"]
    assert "tracer-1" in printed
    assert "report.html" in printed
    assert len(list((folder / "cache").iterdir())) == 1


def test_what_was_measured_before_a_failure_is_kept(config_file, tmp_path):
    """A method that fails at its second setting."""
    status, _, complaint = bench(
        config_file, "--out", tmp_path / "out", "--size", "32x24", "--repeats", 1,
        "--cache", tmp_path / "cache", "--reference", "raycast", "--reference-samples", 16,
        "--methods", "multilayer=4,1,8",
    )  # fmt: skip
    assert status == 1
    assert complaint == "focusjax: multilayer failed on ball_and_wall: layers is 1; expected at least 2\n"
    facts = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [row["setting"] for row in facts["scenes"][0]["rows"]] == [4]
    assert "could not be measured with all its settings" in (tmp_path / "out" / "report.html").read_text()


def test_numbers(finished):
    folder = finished[0]
    facts = json.loads((folder / "out" / "results.json").read_text())
    (scene,) = facts["scenes"]
    assert (scene["width"], scene["height"], scene["title"]) == (32, 24, "Ball & <wall>")
    assert scene["reference"]["maker"] == "raycast"
    assert scene["reference"]["floor_psnr"] > 30
    assert 0 < scene["silhouette_share"] <= 1
    assert scene["failures"].keys() == {"multilayer"}
    assert scene["anchor"] is None
    assert [row["setting"] for row in scene["rows"]] == [8]
    for row in scene["rows"]:
        assert 0 < row["best_seconds"] <= row["seconds"]
        assert row["peak_mib"] > 100
        assert row["compile_seconds"] > 0.1
        assert 0 < row["ssim"] < 1
        assert row["psnr"] > 25
    assert facts["machine"]["cores"] >= 1
    with (folder / "out" / "results.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["psnr"]) for row in rows] == [row["psnr"] for row in scene["rows"]]


def test_the_page_stands_alone(finished):
    page = (finished[0] / "out" / "report.html").read_text()
    assert "Ball &amp; &lt;wall&gt;" in page
    assert page.count("data:image/png;base64,") == 1
    assert page.count("data:image/jpeg;base64,") == 3
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "could not be measured: multilayer failed" in page
    assert "no error to compare times at" in page


@pytest.mark.parametrize(
    ("words", "status", "sentence"),
    [
        (["--methods", "blur"], 2, "there is no method named 'blur'; expected one of tracer"),
        (["--size", "800"], 2, "--size is 800; expected width and height in pixels, such as 800x600"),
        (["--size", "0x9"], 2, "--size is 0x9; expected width and height"),
        (["--repeats", "0"], 2, "repeats is 0; expected at least 1"),
        (["--reference", "painter"], 2, "no reference can be made by 'painter'"),
        (["--reference-samples", "1"], 2, "1 samples per pixel; expected at least 2"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_input_is_one_sentence_and_writes_nothing(config_file, tmp_path, words, status, sentence):
    got, printed, complaint = bench(config_file, "--out", tmp_path / "out", *words)
    assert (got, printed) == (status, "")
    assert complaint.startswith("focusjax: ")
    assert sentence in complaint
    assert complaint.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_missing_configs_and_folders(config_file, tmp_path):
    status, _, complaint = bench(tmp_path / "gone.toml", "--out", tmp_path / "out")
    assert (status, complaint.count("\n")) == (2, 1)
    assert "there is no such config file" in complaint
    assert bench(config_file)[0] == 2
    (tmp_path / "file").write_text("in the way")
    status, _, complaint = bench(config_file, "--out", tmp_path / "file" / "out")
    assert status == 1
    assert "is not writable" in complaint
