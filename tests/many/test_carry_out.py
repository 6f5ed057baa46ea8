"""Tasks by this process, an executor, and processes of Dask of which some are killed."""

import concurrent.futures
import json
import os
import signal
import subprocess
import sys
from contextlib import closing

import distributed
import pytest
from distributed.comm import CommClosedError

from focusjax.many import JOURNAL, Journal, ManyError, Task, carry_out
from focusjax.many._dispatch import _result
from focusjax.many._groups import Waiting
from focusjax.many._worker import attempt, write_probe

sys.path.insert(0, os.path.dirname(__file__))
from cluster_of_processes import ROOT, processes, until
from tasks_for_workers import write


def named(count, seconds=0.0):
    return [Task(f"task{number}", seconds, group=str(number % 2)) for number in range(count)]


def finishes(folder):
    """How often each task was finished, by its own journal."""
    lines = {path.parent.name: path.read_text().splitlines() for path in folder.glob(f"*/{JOURNAL}")}
    return {
        name: sum(json.loads(line)["event"] == "finished" for line in each) for name, each in lines.items()
    }


@pytest.mark.parametrize("executor", [False, True])
def test_one_that_fails_stops_no_other(tmp_path, executor):
    tasks = [*named(2), Task("bad", "wrong")]
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        workers = pool if executor else 1
        ended = {each.task.name: each for each in carry_out(write, tasks, tmp_path, workers=workers)}
    assert ended["bad"].error == "the task is wrong; mend it"
    assert "Traceback" in ended["bad"].log
    assert {name: each.error for name, each in ended.items() if name != "bad"} == {"task0": "", "task1": ""}
    assert finishes(tmp_path) == {"task0": 1, "task1": 1}
    # No journals of tasks under way are left.
    assert not list(tmp_path.glob(".*"))


def test_workers_keep_to_a_group_while_they_can():
    waiting = Waiting(Task(f"{group}{number}", group=group) for group in "ab" for number in range(3))
    taken = [
        waiting.take(own, others).name
        for own, others in [(None, []), (None, "a"), ("a", "b"), ("b", "a"), ("a", "b")]
    ]
    assert taken == ["a0", "b0", "a1", "b1", "a2"]
    # Nothing is left of the first: it helps with the second.
    assert waiting.take("a", "b").name == "b2"
    assert not waiting


def test_processes_that_are_killed_lose_nothing(tmp_path):
    """A worker twice, then the scheduler; then the rest in this process. Each is done once."""
    out, away = tmp_path / "out", tmp_path / "away"
    out.mkdir()
    away.mkdir()
    tasks, ended, killed, complaint = named(40, 0.05), [], [], ""
    with processes(away) as cluster:
        try:
            for each in carry_out(write, tasks, out, workers=str(cluster.file)):
                ended.append(each)
                if len(ended) in (1, 5):
                    killed.append(each.value)
                    os.kill(each.value, signal.SIGKILL)
                if len(ended) == 12:
                    cluster.scheduler.kill()
        except ManyError as error:
            complaint = str(error)
    assert "is gone; start it again and give the same command" in complaint
    assert "with --resume, which keeps what is done" in complaint
    assert len(killed) == 2
    assert {each.error for each in ended} == {""}
    done = finishes(out)
    assert set(done.values()) == {1}
    assert 12 <= len(done) < 40
    missing = [task for task in tasks if not (out / task.name).exists()]
    assert [each.error for each in carry_out(write, missing, out)] == [""] * len(missing)
    assert finishes(out) == {task.name: 1 for task in tasks}


def test_a_task_whose_answer_is_lost_on_its_way_is_done_again():
    """A worker that is killed between the end of a task and its answer closes a connection."""

    class Lost(distributed.Future):
        def __init__(self):
            pass

        def __del__(self):
            pass

        def result(self, timeout):
            raise CommClosedError(f"reset, after less than {timeout} s")

        def cancel(self):
            return None

    waiting = Waiting([])
    assert list(_result(Lost(), Task("task0"), waiting)) == []
    assert waiting.take(None, []).name == "task0"


def test_a_task_at_which_three_processes_ended_is_begun_no_more(tmp_path):
    """Starts without an end are what processes leave behind that are killed. Other runs do not count."""
    journal = Journal(tmp_path, "this")
    journal.open()
    Journal(tmp_path, "other").started("poison")
    for _ in range(2):
        journal.started("poison")
    assert len(journal.starts("poison")) == 2
    journal.started("poison")
    ended = attempt(write, Task("poison", 0.0), journal)
    assert ended.error.startswith("its process ended 3 times before it was done (on ")
    assert not (tmp_path / "poison").exists()
    assert attempt(write, Task("poison", 0.0), journal).error == ""
    assert finishes(tmp_path) == {"poison": 1}


POISON = """
from pathlib import Path
from tasks_for_workers import write
from focusjax.many import Task, carry_out

if __name__ == "__main__":
    tasks = [Task("poison", "kill"), *(Task(f"task{number}", 0.1) for number in range(3))]
    for ended in carry_out(write, tasks, Path.cwd(), workers=2):
        print(ended.task.name, ended.error)
"""


def test_a_task_that_kills_processes_of_this_machine_fails_alone(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(POISON)
    path = os.pathsep.join([str(ROOT), os.path.dirname(__file__)])
    done = subprocess.run(
        [sys.executable, script],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=240,
        check=True,
    )
    said = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert said.pop("poison").startswith("its process ended 3 times before it was done")
    assert said == {"task0": "", "task1": "", "task2": ""}
    assert finishes(tmp_path) == {"task0": 1, "task1": 1, "task2": 1}


def of_another_version(folder):
    """Where workers find another version, by what is installed there, and the rest."""
    (folder / "focusjax-9.9.dist-info").mkdir(parents=True)
    (folder / "focusjax-9.9.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: focusjax\nVersion: 9.9\n"
    )
    return f"{folder}:{ROOT}:{os.path.dirname(__file__)}"


def test_workers_that_cannot_be_used_are_refused_before_work(tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    with processes(tmp_path, 0, path=of_another_version(tmp_path / "other")) as cluster:
        address = json.loads(until(lambda: cluster.file.read_text()))["address"]
        with pytest.raises(ManyError, match=r"the scheduler at tcp.* has no workers; start some"):
            list(carry_out(write, named(1), out, workers=address))
        cluster.start_workers(1)
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(1)
            with pytest.raises(ManyError, match=r"the worker at tcp.* has focusjax 9.9, and this process 0"):
                list(carry_out(write, named(1), out, workers=client))
            # One that hangs: its process is stopped, and its nanny goes on.
            (process,) = client.run(os.getpid).values()
            os.kill(process, signal.SIGSTOP)
            monkeypatch.setattr("focusjax.many._cluster._WORKERS_PATIENCE", 0.5)
            with pytest.raises(ManyError, match="do not answer within 0 seconds; end those that hang"):
                list(carry_out(write, named(1), out, workers=client))
    assert list(out.iterdir()) == []


def test_a_worker_of_another_version_that_joins_later_is_given_nothing(tmp_path):
    out, away, joined = tmp_path / "out", tmp_path / "away", tmp_path / "joined"
    for folder in (out, away, joined):
        folder.mkdir()
    said, done = [], []
    with (
        processes(away, 1) as cluster,
        processes(joined, 0, path=of_another_version(tmp_path / "other")) as late,
    ):
        with distributed.Client(scheduler_file=str(cluster.file), set_as_default=False) as client:
            (known,) = client.run(os.getpid).values()
        late.file = cluster.file
        work = carry_out(write, named(400, 0.1), out, workers=str(cluster.file), on_note=said.append)
        with closing(work) as ended:
            for each in ended:
                done.append(each.value)
                if len(done) == 1:
                    late.start_workers(1)
                if said:
                    break
    assert len(said) == 1
    assert "has focusjax 9.9, and this process 0" in said[0]
    assert said[0].endswith("; until then nothing is done there")
    assert set(done) == {known}


def test_processes_with_equal_numbers_leave_files_of_their_own(tmp_path):
    """As those of containers have."""
    assert len({write_probe(tmp_path, "token") for _ in range(3)}) == 3
    with pytest.raises(OSError, match=r"^No such file or directory$"):
        write_probe(tmp_path / "nowhere", "token")


def test_a_history_stays_when_a_task_of_an_earlier_run_ends(tmp_path):
    """A worker goes on with what it was at when the process that asked has ended."""
    earlier, now = Journal(tmp_path, "earlier"), Journal(tmp_path, "now")
    now.open()
    earlier.started("task")
    now.started("task")
    earlier.ended("task")
    assert len(now.starts("task")) == 1
    now.ended("task")
    assert now.starts("task") == []


def test_a_task_whose_folder_is_gone_fails_alone(tmp_path):
    """A mount that is lost."""

    def lose(task, journal):
        (journal.folder / ".journals").rename(journal.folder / "elsewhere")
        (journal.folder / ".journals").write_text("no folder")
        raise OSError(107, "Transport endpoint is not connected")

    journal = Journal(tmp_path, "run")
    journal.open()
    assert "Transport endpoint is not connected" in attempt(lose, Task("task"), journal).error


@pytest.mark.parametrize(
    ("workers", "sentence"),
    [
        (0, "jobs is 0; expected at least 1 process"),
        ("nowhere.json", "--scheduler nowhere.json: expected the address of a scheduler, such as tcp://"),
        ("foo://127.0.0.1:9", "--scheduler foo://.* has the protocol 'foo'; expected an address such as tcp"),
        (
            __file__,
            r"--scheduler .*test_carry_out.py: expected .* or its scheduler file; the file has no add",
        ),
        (
            "tcp://127.0.0.1:9",
            "there is no scheduler at tcp://127.0.0.1:9 .*; start one",
        ),
    ],
)
def test_workers_that_are_not_there_are_refused(tmp_path, workers, sentence):
    with pytest.raises(ManyError, match=sentence):
        list(carry_out(write, named(2), tmp_path, workers=workers))
    assert list(tmp_path.iterdir()) == []
