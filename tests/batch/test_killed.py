"""Processes that are killed, one at an item and the one that asked for the batch; and those never started."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import trimesh

from focusjax.batch import _pool, make_items, run_batch
from focusjax.batch._work import Task

ROOT = Path(__file__).parents[2]
PATIENCE = 200.0
TABLE = """name,scene.objects.0.file
good,good.obj
crash,crash.obj
wrong,gone.ply
stuck,stuck.obj
"""


def until(condition):
    """What `condition` returns once that is true."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.05)
    return found


def held_open(pipe):
    """A named pipe opened for writing, if some process wants to read it: that one then waits for more."""
    try:
        return os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
    except OSError:
        return None


def reader_of(pipe):
    """The process that reads from a named pipe, if there is one."""
    for number in filter(str.isdecimal, os.listdir("/proc")):
        try:
            files = [os.readlink(f"/proc/{number}/fd/{name}") for name in os.listdir(f"/proc/{number}/fd")]
        except OSError:
            # It is gone, or not ours.
            continue
        if str(pipe) in files and int(number) != os.getpid():
            return int(number)
    return None


def statuses(folder):
    try:
        items = json.loads((folder / "summary.json").read_text())["items"]
    except FileNotFoundError:
        return {}
    return {item["name"]: item["status"] for item in items}


@pytest.mark.skipif(sys.platform != "linux", reason="finds processes by what they read, in /proc")
def test_a_killed_process_fails_its_item_and_a_killed_batch_goes_on(boxes, tmp_path):
    """Meshes whose materials are named pipes hold up whoever loads them until we have killed it."""
    out, table = tmp_path / "out", tmp_path / "table.csv"
    table.write_text(TABLE)
    box = trimesh.creation.box((0.5, 0.5, 0.5)).export(file_type="obj")
    for name in ("good", "crash", "stuck"):
        boxes.with_name(f"{name}.obj").write_text(f"mtllib {name}.mtl\nusemtl plain\n{box}")
    crash, stuck = (boxes.with_name(name) for name in ("crash.mtl", "stuck.mtl"))
    for pipe in (crash, stuck):
        os.mkfifo(pipe)
    words = [boxes, "--table", table, "--solve-only", "--jobs", 2, "--out", out]
    asking = subprocess.Popen(
        [sys.executable, "-m", "focusjax.cli", "batch", *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    ends = []
    try:
        # One of the two processes is at `crash`.
        ends.append(until(lambda: held_open(crash)))
        os.kill(until(lambda: reader_of(crash)), signal.SIGKILL)
        ends.append(until(lambda: held_open(stuck)))
        until(lambda: list(statuses(out).values()) == ["done", "failed", "failed", "waiting"])
        good, killed, _, _ = json.loads((out / "summary.json").read_text())["items"]
        assert killed["message"].startswith(
            "its process was ended by SIGKILL, which often means that memory ran out"
        )
        # Now the batch itself, in the middle of `stuck`.
        until(lambda: reader_of(stuck))
        asking.kill()
        assert asking.wait() == -signal.SIGKILL
        # Its other processes see to it that they end, too.
        until(lambda: reader_of(stuck) is None)
    finally:
        asking.kill()
        complaint = asking.communicate()[1]
        for end in ends:
            os.close(end)
    assert "good.mtl, which does not exist" in good["warnings"][0]
    assert complaint == f"Warning: good: {good['warnings'][0]}\n"
    assert list(out.glob(".unfinished-*"))
    assert not (out / "stuck").exists()

    for pipe in (crash, stuck):
        pipe.unlink()
        pipe.touch()
    before = (out / "good" / "item.json").stat().st_mtime_ns
    batch = run_batch(make_items([boxes], table=table), out, solve_only=True, existing="resume")
    assert {result.item.name: (result.status, result.kept) for result in batch.results} == {
        "good": ("done", True),
        "crash": ("done", False),
        "wrong": ("failed", False),
        "stuck": ("done", False),
    }
    assert (out / "good" / "item.json").stat().st_mtime_ns == before
    assert not list(out.glob(".*"))


def test_processes_that_cannot_start_are_told_of_once(boxes, tmp_path, monkeypatch, capfd):
    # Any function that does not take these arguments will do.
    monkeypatch.setattr(_pool, "_serve", time.sleep)
    items = make_items([boxes], grid={"render.rays": [4, 8]})
    with pytest.raises(RuntimeError, match=r"could not start: its process ended with status 1; a script"):
        run_batch(items, tmp_path / "out", jobs=2)
    assert "TypeError" in capfd.readouterr().err
    assert statuses(tmp_path / "out") == {item.name: "waiting" for item in items}


def test_processes_keep_to_a_config_while_they_can(boxes):
    other = boxes.with_name("other.toml")
    other.write_text(boxes.read_text())
    items = make_items([boxes, other], grid={"render.rays": [4, 8, 16]})
    waiting = [Task(item, {}) for item in items]
    first, second = (task.group for task in (waiting[0], waiting[-1]))
    taken = []
    for own, others in [(None, []), (None, [first]), (first, [second]), (second, [first]), (first, [second])]:
        taken.append(_pool._take(waiting, own, others).item.config.source)
    assert taken == [boxes, other, boxes, other, boxes]
    # Nothing is left of the first: it helps with the second.
    assert _pool._take(waiting, first, [second]).item is items[-1]
    assert waiting == []
