"""A run's folder gets all of its files or none."""

import pytest

from focusjax.io import replace_file, staged_folder, whole_folder


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


def fail_in(folder):
    with staged_folder(folder) as stage:
        (stage / "a.txt").write_text("half")
        raise RuntimeError("stop")


def test_a_failure_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError, match="stop"):
        fail_in(tmp_path / "deep" / "run")
    assert not list(tmp_path.iterdir())


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
