"""A data set on a cluster that is killed bit by bit, and gone on with by this process."""

import json
import os
import signal
import sys
from pathlib import Path

import pytest

from focusjax.dataset import _run, make_dataset, spec_of
from focusjax.many import ManyError

sys.path.insert(0, str(Path(__file__).parents[1] / "many"))
from cluster_of_processes import processes

COUNT = 12
SMALL = {
    "camera": {"resolution": [32, 24]},
    "scene": {"objects": 2},
    "render": {"rays": 4, "max_layers": 4},
}


def made_at(folder):
    """The file of each picture, and when it appeared: a picture that is made again has another."""
    stats = {path.stem: path.stat() for path in folder.glob("000/[0-9]*.npz")}
    return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in stats.items()}


def at_work(folder):
    """The processes that have begun pictures and not made them all, by the histories of these."""
    texts = (path.read_text() for path in (folder / ".journals").glob("*.jsonl"))
    return {json.loads(text.splitlines()[-1])["process"] for text in texts if text}


@pytest.mark.slow
def test_a_data_set_whose_workers_and_scheduler_are_killed_is_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(_run, "GROUP", 1)
    spec = spec_of(SMALL)
    out, away, alone = tmp_path / "out", tmp_path / "away", tmp_path / "alone"
    away.mkdir()
    first_seen, killed = {}, []
    with processes(away) as cluster:

        def kill(_):
            first_seen.update({name: at for name, at in made_at(out).items() if name not in first_seen})
            workers = at_work(out).difference(killed)
            if len(first_seen) >= 2 * len(killed) + 1 and len(killed) < 2 and workers:
                killed.append(workers.pop())
                os.kill(killed[-1], signal.SIGKILL)
            if len(first_seen) >= 6 and len(killed) == 2:
                cluster.scheduler.kill()

        with pytest.raises(ManyError, match=r"is gone; start it again and give the same command.* --resume"):
            make_dataset(spec, COUNT, out, workers=str(cluster.file), on_done=kill)
        lines = (out / "manifest.jsonl").read_text().splitlines()
        assert len(lines) >= 6
    assert len(killed) == 2
    rest = make_dataset(spec, COUNT, out, resume=True)
    assert (rest.there, rest.failed) == (COUNT, ())
    assert 6 <= rest.kept < COUNT
    # No picture was made a second time, whoever had begun it.
    ended = made_at(out)
    assert len(ended) == COUNT
    assert {name: ended[name] for name in first_seen} == first_seen
    assert not [path for path in out.rglob(".*") if path.name != ".lock"]
    make_dataset(spec, COUNT, alone)
    for path in sorted(alone.rglob("*.*")):
        assert (out / path.relative_to(alone)).read_bytes() == path.read_bytes(), path
