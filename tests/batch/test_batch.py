"""A batch from outside: its files, its summary, what it keeps, and its exit status."""

import csv
import json
import re
import shutil
import time
from pathlib import Path

import imageio.v3 as iio
import pytest
import trimesh
from boxes_config import write_boxes

from focusjax.batch import BatchError, _run, make_items, run_batch
from focusjax.many import Ended

GRID = ("--grid", "focus.1.blur_px=[3, 4]")
NAMES = ["boxes,focus.1.blur_px=3", "boxes,focus.1.blur_px=4"]
TABLE = 'name,focus.1.blur_px,focus.0.point,focus.1.weight\ngood,3,,\nbehind,,"[0, 0, 3]",0\n<wide>,400,,\n'


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A config, and a table of a good row, one that fails, and one whose wish is out of reach."""
    folder = tmp_path_factory.mktemp("batch")
    (folder / "table.csv").write_text(TABLE)
    write_boxes(folder)
    return folder


@pytest.fixture
def config(scene, tmp_path):
    """A copy of the config that a test may change."""
    shutil.copy(scene / "box.ply", tmp_path)
    return Path(shutil.copy(scene / "boxes.toml", tmp_path))


def solve(items, folder, **options):
    """A batch without pictures, and what it reported: results and notes."""
    results, notes = [], []
    batch = run_batch(
        items, folder, solve_only=True, on_result=results.append, on_note=notes.append, **options
    )
    return batch, results, notes


def summary(folder):
    return json.loads((folder / "summary.json").read_text())


def rows(folder):
    with (folder / "summary.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def mixed(scene, batch):
    """The table's batch, a failing item among good ones, from the command line; and its folder."""
    options = ("--table", scene / "table.csv", "--solve-only", "--out", scene / "out")
    return batch(scene / "boxes.toml", *options), scene / "out"


def test_a_failing_item_is_named_and_stops_no_other(mixed):
    (status, printed, complaint), folder = mixed
    assert status == 1
    assert re.fullmatch(r"focusjax: behind failed: .*box's front.* behind the camera.*\n", complaint)
    assert "good  focus 1.75 m, f/" in printed
    reason = complaint.strip().removeprefix("focusjax: behind failed: ")
    assert f"behind  failed: {reason}\n" in printed
    assert "2 of 3 done" in printed
    assert str(folder / "summary.html") in printed
    names = ["behind", "good", "summary.csv", "summary.html", "summary.json", "wide"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert [path.name for path in (folder / "behind").iterdir()] == ["failed.log"]
    log = (folder / "behind" / "failed.log").read_text()
    assert log.startswith(f"{reason}\n")
    assert "Traceback" in log
    files = ["blur.png", "item.json", "journal.jsonl", "report.html", "report.json", "thumbnail.jpg"]
    assert sorted(path.name for path in (folder / "good").iterdir()) == files


def test_a_misspelt_object_is_reported_with_item_key_and_nearest_name(config, tmp_path, batch):
    status, printed, _ = batch(config, "--grid", 'focus.1.object=["far bix"]', "--out", tmp_path / "out")
    assert status == 1
    assert "boxes,focus.1.object=far_bix  failed: " in printed
    assert (
        "boxes.toml: focus.1.object: there is no object named 'far bix'; did you mean 'far box'?" in printed
    )


def test_the_summary_as_a_table(mixed):
    good, behind, wide = rows(mixed[1])
    assert [row["name"] for row in (good, behind, wide)] == ["good", "behind", "wide"]
    assert [row["status"] for row in (good, behind, wide)] == ["done", "failed", "done"]
    assert (good["focus.1.blur_px"], good["focus.0.point"]) == ("3", "")
    assert (behind["focus.1.blur_px"], behind["focus.0.point"]) == ("", "[0, 0, 3]")
    report = json.loads((mixed[1] / "good" / "report.json").read_text())
    assert float(good["focus_distance_m"]) == report["lens"]["focus_distance_m"]
    assert float(good["f_number"]) == report["lens"]["f_number"]
    assert float(good["cost_px2"]) == report["solver"]["cost_px2"]
    assert (good["tilt_deg"], good["swing_deg"], good["solver"]) == ("0.0", "0.0", "solved")
    assert (good["verdict"], good["wishes"], good["wishes_met"]) == ("met", "2", "2")
    worst = max(report["wishes"], key=lambda wish: abs(wish["residual_px"]))
    assert float(good["worst_error_px"]) == abs(worst["residual_px"])
    assert float(good["seconds"]) > 0
    assert (wide["verdict"], wide["wishes_met"], wide["worst_wish"]) == ("missed", "0", "far box")
    assert wide["active_bounds"] == "min_focus_distance min_f_number"
    assert (behind["focus_distance_m"], behind["seconds"], behind["verdict"]) == ("", "", "")
    assert "behind the camera" in behind["message"]


def test_the_summary_as_json(mixed):
    facts = summary(mixed[1])
    assert facts["schema"] == "focusjax.batch.summary/1"
    assert facts["counts"] == {"items": 3, "done": 2, "failed": 1, "waiting": 0}
    assert facts["finished"]
    assert facts["solve_only"]
    good, behind, wide = facts["items"]
    assert good["changes"] == {"focus.1.blur_px": 3}
    assert [wish["name"] for wish in good["wishes"]] == ["box's front", "far box"]
    assert good["lens"]["focus_distance_m"] == pytest.approx(1.75, rel=1e-4)  # observed 1e-6
    assert (wide["folder"], behind["folder"]) == ("wide", None)
    assert (behind["status"], behind["lens"], behind["wishes_met"]) == ("failed", None, 0)
    assert "behind the camera" in behind["message"]


def test_the_summary_as_a_page(mixed):
    page = (mixed[1] / "summary.html").read_text()
    links = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert {"good/report.html", "good/thumbnail.jpg", "wide/report.html", "summary.csv"} <= set(links)
    assert all((mixed[1] / link).exists() for link in links)
    assert page.index("behind the camera") < page.index("good/report.html")
    assert "✓ 2 of 2" in page
    assert "✗ 0 of 2" in page
    assert "3 items of 1 config" in page
    assert "[0, 0, 3]" not in page[page.index("good/report.html") :]


def test_the_thumbnail_is_of_the_blur_where_no_picture_is(mixed):
    folder = mixed[1] / "good"
    small, whole = iio.imread(folder / "thumbnail.jpg"), iio.imread(folder / "blur.png")
    assert small.shape[1] == 320
    assert small.shape[0] / 320 == pytest.approx(whole.shape[0] / whole.shape[1], abs=0.01)


def test_going_on_repeats_what_failed_and_nothing_else(mixed, scene):
    items = make_items([scene / "boxes.toml"], table=scene / "table.csv")
    before = (mixed[1] / "good" / "item.json").stat().st_mtime_ns
    batch, results, notes = solve(items, mixed[1], existing="resume")
    assert [(result.item.name, result.kept) for result in results] == [
        ("good", True),
        ("wide", True),
        ("behind", False),
    ]
    assert notes == []
    assert [result.item.name for result in batch.failed] == ["behind"]
    assert (mixed[1] / "good" / "item.json").stat().st_mtime_ns == before
    assert [row["name"] for row in rows(mixed[1])] == ["good", "behind", "wide"]


def test_an_interrupted_batch_loses_nothing_and_repeats_nothing(config, tmp_path):
    items = make_items([config], grid={"focus.1.blur_px": [3, 4, 5]})

    def interrupt(result):
        assert result.item is items[0]
        raise KeyboardInterrupt

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        run_batch(items, out, solve_only=True, on_result=interrupt)
    assert summary(out)["counts"] == {"items": 3, "done": 1, "failed": 0, "waiting": 2}
    assert not summary(out)["finished"]
    page = (out / "summary.html").read_text()
    assert "boxes,focus.1.blur_px=4 · boxes,focus.1.blur_px=5" in page
    # What another end of the process would have left.
    (out / ".unfinished-x").mkdir()
    (out / ".unfinished-x" / "report.json").write_text("{")
    batch, results, _ = solve(items, out, existing="resume")
    assert [result.kept for result in results] == [True, False, False]
    assert [result.status for result in batch.results] == ["done"] * 3
    assert not list(out.glob(".*"))
    assert summary(out)["finished"]


def test_the_summary_does_not_wait_for_an_item_that_takes_long(config, tmp_path, monkeypatch):
    """The second result comes right after the first, before a summary may be written again."""
    out = tmp_path / "out"

    def two_at_once(work, tasks, *_, **more):
        yield Ended(tasks[0], error="bad")
        yield Ended(tasks[1], error="bad")
        end = time.monotonic() + 60
        while summary(out)["counts"]["failed"] < 2:
            assert time.monotonic() < end, summary(out)["counts"]
            time.sleep(0.01)
        yield Ended(tasks[2], error="bad")

    monkeypatch.setattr(_run, "carry_out", two_at_once)
    solve(make_items([config], grid={"focus.1.blur_px": [3, 4, 5]}), out)
    assert summary(out)["counts"]["failed"] == 3
    assert summary(out)["finished"]


def test_a_summary_for_which_there_is_no_room_stops_no_item(config, tmp_path, monkeypatch):
    """A full disk; with room, going on writes it."""
    out, items = tmp_path / "out", make_items([config], grid={"focus.1.blur_px": [3, 4]})

    def full(batch):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(_run, "save_summary", full)
        batch, _, notes = solve(items, out)
    assert [result.status for result in batch.results] == ["done", "done"]
    assert notes[-1].startswith("the summary could not be written (No space left on device); with room")
    assert not (out / "summary.json").exists()
    solve(items, out, existing="resume")
    assert summary(out)["counts"]["done"] == 2


def test_a_batch_whose_scheduler_is_not_there_leaves_nothing(config, tmp_path, batch):
    words = [config, "--out", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9"]
    status, _, complaint = batch(*words)
    assert status == 2
    assert "there is no scheduler at tcp://127.0.0.1:9" in complaint
    assert not (tmp_path / "out").exists()


def test_what_has_changed_is_done_again_and_said_so(config, tmp_path):
    out, grid = tmp_path / "out", {"focus.1.blur_px": [3, 4]}
    solve(make_items([config], grid=grid), out)
    config.write_text(config.read_text().replace("f_number_min = 0.2", "f_number_min = 0.3"))
    _, results, notes = solve(make_items([config], grid=grid), out, existing="resume")
    assert [result.kept for result in results] == [False, False]
    assert notes == [f"{name} is done again: solve.f_number_min has changed" for name in NAMES]
    # One of the two.
    saved = json.loads((out / NAMES[0] / "item.json").read_text())
    saved["fingerprint"]["config"]["focus"][1]["weight"] = 2.0
    (out / NAMES[0] / "item.json").write_text(json.dumps(saved))
    _, results, notes = solve(make_items([config], grid=grid), out, existing="resume")
    assert {result.item.name: result.kept for result in results} == {NAMES[0]: False, NAMES[1]: True}
    assert notes == [f"{NAMES[0]} is done again: focus.1.weight has changed"]
    # A file that the config names.
    trimesh.creation.box((0.5, 0.5, 0.4)).export(config.with_name("box.ply"))
    _, results, notes = solve(make_items([config], grid=grid)[:1], out, existing="resume")
    assert notes == [f"{NAMES[0]} is done again: the file box.ply has changed"]
    assert [result.status for result in results] == ["done"]


def test_a_picture_is_made_where_there_was_none(config, tmp_path, batch):
    out = tmp_path / "out"
    solve(make_items([config]), out)
    status, printed, complaint = batch(config, "--out", out, "--resume")
    assert (status, complaint) == (0, "Note: boxes is done again: it was solved without a picture\n")
    assert "1 of 1 done\n" in printed
    assert iio.imread(out / "boxes" / "image.png").shape == (30, 40, 3)
    assert iio.imread(out / "boxes" / "thumbnail.jpg").shape == (30, 40, 3)
    status, printed, complaint = batch(config, "--out", out, "--resume")
    assert (status, complaint) == (0, "")
    assert "kept" in printed
    assert "1 of 1 done, 1 of them before" in printed


def test_a_folder_in_use_is_refused_or_replaced(config, tmp_path, batch):
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    status, printed, complaint = batch(config, "--out", out, "--solve-only")
    assert (status, printed) == (2, "")
    assert "out already holds 'notes.txt'; use --resume to do what is missing there, --overwrite" in complaint
    old = out / "of an earlier batch"
    old.mkdir()
    (old / "item.json").write_text("{}")
    status, _, _ = batch(config, "--out", out, "--solve-only", "--overwrite")
    assert status == 0
    names = ["boxes", "notes.txt", "summary.csv", "summary.html", "summary.json"]
    assert sorted(path.name for path in out.iterdir()) == names


def test_what_no_batch_made_is_never_replaced(config, tmp_path, batch):
    (tmp_path / "out" / "boxes").mkdir(parents=True)
    (tmp_path / "out" / "boxes" / "image.png").write_text("mine")
    for option in ("--overwrite", "--resume"):
        status, _, complaint = batch(config, "--out", tmp_path / "out", option)
        assert status == 2
        assert "boxes is from no batch; move it, or choose another --out" in complaint
        assert (tmp_path / "out" / "boxes" / "image.png").read_text() == "mine"


def test_two_batches_do_not_share_a_folder(config, tmp_path):
    out = tmp_path / "out"

    def again(_):
        solve(make_items([config]), out, existing="resume")

    with pytest.raises(BatchError, match=r"another run is writing to .*out; wait for it, or choose"):
        run_batch(make_items([config]), out, solve_only=True, on_result=again)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["--grid", "lens.fnumber=[2]"],
            "--grid lens.fnumber=2: {config}: unknown key lens.fnumber; did you",
        ),
        (["--grid", "lens.f_number=2"], "expected KEY=[VALUE, ...], for example lens.f_number=[2, 4, 8]"),
        (["--set", "render.rays=0"], "render.rays is 0; expected a number of at least 1"),
        (["--table", "gone.csv"], "gone.csv: there is no such table; check the path"),
        (["--jobs", "0"], "jobs is 0; expected at least 1 process"),
        (["--scheduler", "x", "--jobs", "2"], "--scheduler x has workers of its own; leave out --jobs 2"),
        (["--resume", "--overwrite"], "--resume keeps what is there and --overwrite removes it; give one"),
        (["gone.toml"], "gone.toml: there is no such config file; check the path"),
        (["{config}"], "two items are the same"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_input_is_one_sentence_and_starts_nothing(config, tmp_path, batch, words, sentence):
    words = [word.replace("{config}", str(config)) for word in words]
    status, printed, complaint = batch(config, "--out", tmp_path / "a" / "b", *words)
    assert (status, printed) == (2, "")
    assert complaint.startswith("focusjax: ")
    assert sentence.replace("{config}", str(config)) in complaint
    assert complaint.count("\n") == 1
    assert not (tmp_path / "a").exists()


def test_a_batch_file_says_it_all(config, tmp_path, batch):
    path = tmp_path / "batch.toml"
    path.write_text('[batch]\nconfigs = ["boxes.toml"]\n[batch.grid]\nfocus.1.blur_px = [3]\n')
    status, _, complaint = batch(path, "--out", tmp_path / "out", *GRID)
    assert status == 2
    assert "batch.toml has a [batch] table, which says it all; leave out --grid, --table and" in complaint
    status, _, complaint = batch(path, "--out", tmp_path / "out", "--solve-only")
    assert (status, complaint) == (0, "")
    assert (tmp_path / "out" / NAMES[0] / "report.html").exists()


def test_a_folder_that_cannot_be_made(config, tmp_path, batch):
    (tmp_path / "file").write_text("in the way")
    status, _, complaint = batch(config, "--out", tmp_path / "file" / "out")
    assert status == 2
    assert re.search(r"folder .*out cannot be used \(Not a directory\); choose another with --out", complaint)


def test_an_interrupt_is_no_traceback(config, tmp_path, batch, monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("focusjax.batch._command.run_batch", interrupt)
    status, _, complaint = batch(config, "--out", tmp_path / "out")
    assert status == 130
    assert complaint == "focusjax: interrupted; --resume goes on with what is not done\n"
