"""A run's folder gets all of its files or none."""

import signal
import subprocess
import sys

import pytest

from focusjax.io import FolderInUseError, replace_file, staged_folder, whole_folder


def test_files_arrive_together_and_replace_older_ones(tmp_path):
    out = tmp_path / "deep" / "run"
    out.mkdir(parents=True)
    (out / "a.txt").write_text("old")
    with staged_folder(out) as stage:
        (stage / "a.txt").write_text("new")
        (stage / "b.txt").write_text("more")
        assert (out / "a.txt").read_text() == "old"
    assert sorted(file.name for file in out.iterdir()) == ["a.txt", "b.txt"]
    assert (out / "a.txt").read_text() == "new"


RACE = """
import sys, time
from pathlib import Path
from focusjax.io import FolderInUseError, staged_folder

out, mark, wait = Path(sys.argv[1]), sys.argv[2], float(sys.argv[3])
try:
    with staged_folder(out, owned=["extra.txt"]) as stage:
        for number in range(40):
            (stage / f"{number}.txt").write_text(mark)
            time.sleep(wait)
        if mark == "0":
            (stage / "extra.txt").write_text(mark)
except FolderInUseError as error:
    sys.exit(str(error))
"""


def test_of_runs_into_one_folder_one_is_whole(tmp_path):
    """Five processes at once: who is refused says so, and the folder holds all of one and no more."""
    out = tmp_path / "out"
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", RACE, out, str(mark), "0.02"], stderr=subprocess.PIPE, text=True
        )
        for mark in range(5)
    ]
    said = [run.communicate()[1] for run in runs]
    done = [mark for mark, run in enumerate(runs) if run.returncode == 0]
    assert done
    assert all(
        "another run is writing to" in text for text, run in zip(said, runs, strict=True) if run.returncode
    )
    held = {file.name: file.read_text() for file in out.iterdir()}
    marks = set(held.values())
    assert len(marks) == 1
    assert int(marks.pop()) in done
    assert len(held) == 40 + ("extra.txt" in held)
    assert ("extra.txt" in held) == (set(held.values()) == {"0"})


def test_a_folder_in_use_is_refused_and_let_go(tmp_path):
    def write():
        with staged_folder(tmp_path / "out") as stage:
            (stage / "a.txt").write_text("second")

    with staged_folder(tmp_path / "out") as stage:
        (stage / "a.txt").write_text("first")
        with pytest.raises(
            FolderInUseError, match=r"another run is writing to .*out; wait for it, or choose"
        ):
            write()
    assert (tmp_path / "out" / "a.txt").read_text() == "first"
    write()
    assert (tmp_path / "out" / "a.txt").read_text() == "second"


def fail_in(folder):
    with staged_folder(folder) as stage:
        (stage / "a.txt").write_text("half")
        raise RuntimeError("stop")


def test_a_failure_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError, match="stop"):
        fail_in(tmp_path / "deep" / "run")
    assert not list(tmp_path.iterdir())


KILLED = """
import os, signal, sys
from pathlib import Path
from focusjax.io import staged_folder

out, left = Path(sys.argv[1]), int(sys.argv[2])

def at_last(change):
    def changed(*arguments, **options):
        global left
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left -= 1
        return change(*arguments, **options)
    return changed

with staged_folder(out, owned=["a", "b", "gone"]) as stage:
    (stage / "a").write_text("new")
    (stage / "b").write_text("new")
    os.replace, os.unlink, os.rmdir = map(at_last, (os.replace, os.unlink, os.rmdir))
"""
OLD, NEW = dict.fromkeys(("a", "b", "gone"), "old"), dict.fromkeys(("a", "b"), "new")


def test_a_run_that_is_killed_as_its_files_move_is_finished_by_the_next(tmp_path):
    """Killed before each of its six changes to the folder: the first makes what is new final."""
    outs = [tmp_path / str(step) for step in range(6)]
    for out in outs:
        out.mkdir()
        for name, text in {**OLD, "notes": "mine"}.items():
            (out / name).write_text(text)
    runs = [subprocess.Popen([sys.executable, "-c", KILLED, out, str(step)]) for step, out in enumerate(outs)]
    assert [run.wait() for run in runs] == [-signal.SIGKILL] * len(runs)
    mixed = 0
    for step, out in enumerate(outs):
        held = {file.name: file.read_text() for file in out.iterdir() if file.is_file()}
        mixed += held not in ({**OLD, "notes": "mine"}, {**NEW, "notes": "mine"})
        left = [path.name for path in out.iterdir() if path.is_dir()]
        assert len(left) == 1
        assert left[0].startswith(".unfinished-run-") if step == 0 else left == [".arriving"]
        # The next run fails: what is there is all of the old or all of the killed one.
        with pytest.raises(RuntimeError, match="stop"):
            fail_in(out)
        held = {file.name: file.read_text() for file in out.iterdir()}
        assert held == {**(NEW if step else OLD), "notes": "mine"}
    assert mixed == 2


def test_a_folder_where_a_file_goes_is_refused_before_anything_moves(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    (tmp_path / "b.txt").mkdir()

    def write():
        with staged_folder(tmp_path) as stage:
            (stage / "a.txt").write_text("new")
            (stage / "b.txt").write_text("new")

    with pytest.raises(IsADirectoryError, match="move it"):
        write()
    assert (tmp_path / "a.txt").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "b.txt"]


def test_not_writable_is_said_before_any_work(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ValueError, match=r"output folder .*file/run is not writable .* choose another"):
        fail_in(tmp_path / "file" / "run")


def test_files_of_an_earlier_run_do_not_stay(tmp_path):
    for name in ("image.png", "report.json", "notes.txt"):
        (tmp_path / name).write_text("old")
    with staged_folder(tmp_path, owned=("image.png", "report.json")) as stage:
        (stage / "report.json").write_text("new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["notes.txt", "report.json"]
    assert (tmp_path / "report.json").read_text() == "new"


def test_a_whole_folder_takes_its_place_at_once(tmp_path):
    out = tmp_path / "item"
    out.mkdir()
    (out / "old.txt").write_text("old")
    with whole_folder(out) as stage:
        (stage / "new.txt").write_text("new")
        assert [file.name for file in out.iterdir()] == ["old.txt"]
    assert [file.name for file in out.iterdir()] == ["new.txt"]
    assert [path.name for path in tmp_path.iterdir()] == ["item"]
    # Others may read it as far as they may read any new folder.
    (tmp_path / "plain").mkdir()
    assert out.stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_whole_folder_is_not_there_after_a_failure(tmp_path):
    def fail():
        with whole_folder(tmp_path / "item") as stage:
            (stage / "a.txt").write_text("half")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        fail()
    assert not list(tmp_path.iterdir())


def test_a_replaced_file_keeps_its_line_ends(tmp_path):
    (tmp_path / "a.csv").write_text("old")
    replace_file(tmp_path / "a.csv", "é,1\r\n")
    assert (tmp_path / "a.csv").read_bytes() == "é,1\r\n".encode()
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
