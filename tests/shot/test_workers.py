"""Frames of a shot by many processes: the same bit for bit, each once, whatever is killed."""

import json
import os
import signal
import sys
from pathlib import Path

import pytest
from cards_config import write_cards
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import load_config
from focusjax.io import load_exr
from focusjax.many import ManyError
from focusjax.shot import build_settings, build_shot, render_frames, solve_shot
from focusjax.shot._frame_files import Record, read_record, write_record

sys.path.insert(0, str(Path(__file__).parents[1] / "many"))
from cluster_of_processes import processes

COUNT = 12


@pytest.fixture(scope="module")
def config_file(tmp_path_factory) -> Path:
    return write_cards(tmp_path_factory.mktemp("shot"))


def solved_with(config_file, *changes):
    config = load_config(config_file, [f"shot.frames={COUNT}", *changes])
    return solve_shot(build_shot(config)), build_settings(config)


def contents(folder):
    """Frames by their names: PNG files as they are, and the pixels of the others, whose files name a time."""
    found = {path.name: path.read_bytes() for path in folder.glob("*.png")}
    for path in folder.glob("*.exr"):
        channels = load_exr(path)
        found[path.name] = {name: channels[name].tobytes() for name in sorted(channels)}
    return found


def finishes(folder):
    """How often each frame was finished, by its own record, and the process that did it last."""
    found = {}
    for path in sorted((folder / ".made").glob("*.json")):
        lines = [json.loads(line) for line in read_record(folder, path.stem).journal.splitlines()]
        ends = [line["process"] for line in lines if line["event"] == "finished"]
        if ends:
            found[path.stem] = (len(ends), ends[-1])
    return found


@pytest.mark.slow
def test_frames_of_workers_and_a_scheduler_that_are_killed_are_gone_on_with(config_file, tmp_path):
    solved, settings = solved_with(config_file)
    out, away, alone = tmp_path / "out", tmp_path / "away", tmp_path / "alone"
    for folder in (out, away, alone):
        folder.mkdir()
    formats = ("png", "exr")
    with processes(away) as cluster:
        killed = []

        def kill(_, share):
            made = round(share * COUNT)
            if made in (1, 3):
                killed.append(list(finishes(out).values())[-1][1])
                os.kill(killed[-1], signal.SIGKILL)
            if made == 6:
                cluster.scheduler.kill()

        with pytest.raises(ManyError, match="is gone; start it again"):
            render_frames(solved, out, settings, formats=formats, workers=str(cluster.file), progress=kill)
    assert len(killed) == 2
    rest = render_frames(solved, out, settings, formats=formats)
    assert 6 <= rest.kept < COUNT
    names = [f"frame_{number:04d}" for number in range(1, COUNT + 1)]
    assert {name: count for name, (count, _) in finishes(out).items()} == dict.fromkeys(names, 1)
    assert {path.name for path in out.glob(".*")} == {".made"}
    render_frames(solved, alone, settings, formats=formats)
    assert contents(out) == contents(alone)


@pytest.mark.parametrize(
    "changes", [["render.method=post"], pytest.param(["shutter.angle_deg=180"], marks=pytest.mark.slow)]
)
def test_two_processes_make_the_same_frames_bit_for_bit(config_file, tmp_path, changes):
    """Where sizes of layers are those of frames that the process made before, too."""
    solved, settings = solved_with(config_file, *changes)
    made = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        folder.mkdir()
        made.append(render_frames(solved, folder, settings, frames=[1, 5, 9, 12], workers=workers))
    assert contents(tmp_path / "1") == contents(tmp_path / "2")
    assert made[0].motion_px == made[1].motion_px
    assert made[0].kept == made[1].kept == 0


def test_a_frame_that_fails_stops_no_other(config_file, tmp_path, monkeypatch):
    solved, settings = solved_with(config_file)

    def full(path, *rest):
        if "0002" in path.name:
            raise OSError(28, "No space left on device")
        path.write_bytes(b"a picture")

    with monkeypatch.context() as patched:
        patched.setattr("focusjax.shot._frame.save_frame", full)
        with pytest.raises(RuntimeError, match=r"frame 2: No space left on device.*there \(2\) are kept"):
            render_frames(solved, tmp_path, settings, frames=[1, 2, 3])
    assert "No space left" in (tmp_path / "frame_0002.log").read_text()
    assert not list(tmp_path.glob(".unfinished*"))
    assert render_frames(solved, tmp_path, settings, frames=[1, 2, 3]).kept == 2
    assert not (tmp_path / "frame_0002.log").exists()


def test_a_frame_that_is_damaged_is_made_again(config_file, tmp_path):
    solved, settings = solved_with(config_file)
    render_frames(solved, tmp_path, settings, frames=[1, 2])
    before = contents(tmp_path)
    (tmp_path / "frame_0002.png").write_bytes(b"")
    assert render_frames(solved, tmp_path, settings, frames=[1, 2]).kept == 1
    assert contents(tmp_path) == before


def test_a_frame_that_another_process_made_meanwhile_stays(config_file, tmp_path, monkeypatch):
    """One that goes on for a run whose process has ended does not replace newer pictures."""
    solved, settings = solved_with(config_file)
    monkeypatch.setattr("focusjax.shot._frame.save_frame", meanwhile(tmp_path))
    with pytest.raises(RuntimeError, match="frame 1: another process made this frame meanwhile"):
        render_frames(solved, tmp_path, settings, frames=[1])
    assert (tmp_path / "frame_0001.png").read_bytes() == b"newer"
    assert read_record(tmp_path, "frame_0001").marks == {"frame_0001.png": "newer"}


def meanwhile(folder):
    def save(path, *rest):
        path.write_bytes(b"older")
        (folder / "frame_0001.png").write_bytes(b"newer")
        write_record(folder, "frame_0001", Record({"frame_0001.png": "newer"}, {"frame_0001.png": 5}))

    return save


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scheduler", "tcp://127.0.0.1:1"], "there is no scheduler at tcp://127.0.0.1:1"),
        (["--scheduler", "tcp://127.0.0.1:1", "--jobs", "2"], "has workers of its own; leave out --jobs 2"),
        (["--jobs", "0"], "jobs is 0; expected at least 1 process"),
    ],
)
def test_workers_that_cannot_be_used_are_refused(config_file, tmp_path, options, message):
    result = CliRunner().invoke(app, ["shot", str(config_file), "--out", str(tmp_path), *options])
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.output.split())
    assert "Solving" not in result.output
    assert not (tmp_path / "frames").exists()
