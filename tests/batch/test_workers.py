"""A batch on a cluster that is killed bit by bit, and gone on with by other workers."""

import json
import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from focusjax.batch import make_items, run_batch
from focusjax.many import JOURNAL, ManyError

sys.path.insert(0, str(Path(__file__).parents[1] / "many"))
from cluster_of_processes import processes

COUNT = 40


def finished(folder):
    """How often each item was finished, by its own journal; and the process that did it last."""
    found = {}
    for path in folder.glob(f"*/{JOURNAL}"):
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        ends = [line["process"] for line in lines if line["event"] == "finished"]
        found[path.parent.name] = (len(ends), ends[-1])
    return found


def test_a_batch_whose_workers_and_scheduler_are_killed_is_gone_on_with(boxes, tmp_path):
    grid = {"focus.1.blur_px": [round(2.0 + 0.05 * number, 2) for number in range(COUNT)]}
    items = make_items([boxes], grid=grid)
    out, away, alone = tmp_path / "out", tmp_path / "away", tmp_path / "alone"
    away.mkdir()
    with processes(away) as cluster:
        ended = []

        def kill(result):
            ended.append(result)
            if len(ended) in (1, 8):
                os.kill(finished(out)[result.item.name][1], signal.SIGKILL)
            if len(ended) == 16:
                cluster.scheduler.kill()

        with pytest.raises(ManyError, match=r"is gone; start it again and give the same command.* --resume"):
            run_batch(items, out, workers=str(cluster.file), solve_only=True, on_result=kill)
    assert {result.status for result in ended} == {"done"}
    facts = json.loads((out / "summary.json").read_text())
    assert (facts["finished"], facts["counts"]["failed"]) == (False, 0)
    rest = run_batch(items, out, solve_only=True, existing="resume")
    kept = [result for result in rest.results if result.kept]
    assert 16 <= len(kept) < COUNT
    assert {name: count for name, (count, _) in finished(out).items()} == {item.name: 1 for item in items}
    assert not list(out.glob(".*"))
    # Those that the cluster did, as this process does them.
    chosen = [result.item for result in kept[:3]]
    run_batch(chosen, alone, solve_only=True)
    for item in chosen:
        ours, theirs = (json.loads((each / item.name / "report.json").read_text()) for each in (alone, out))
        for key in ("lens", "wishes", "solver"):
            assert ours[key] == theirs[key]
        pictures = [np.asarray(Image.open(each / item.name / "blur.png")) for each in (alone, out)]
        np.testing.assert_array_equal(*pictures)
    shutil.rmtree(alone)
