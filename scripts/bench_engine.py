"""What it costs to have many things done: per task, by more workers, and in bytes through the scheduler.

    python scripts/bench_engine.py                      # 1000 tasks that do nothing, by 1 and 2 processes
    python scripts/bench_engine.py --tasks 100000       # the simulation of a large run
    python scripts/bench_engine.py --config configs/still_life.toml --items 100

Prints lines of JSON. With a config its items are solved without pictures, by this process, 1 and 2 processes.
"""

import argparse
import json
import pickle
import tempfile
import time
from pathlib import Path

from focusjax.batch import ItemResult, make_items, run_batch
from focusjax.batch._fingerprint import Fingerprints
from focusjax.batch._work import DoItem, task_of
from focusjax.many import Journal, Task, carry_out
from focusjax.many._worker import attempt


def nothing(task: Task, journal: Journal) -> None:
    """Do nothing."""


def timed(count: int, workers: int | str) -> dict[str, float]:
    """Seconds for tasks that do nothing, from the first that ends to the last."""
    tasks = [Task(str(number)) for number in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        ends = [time.perf_counter() for _ in carry_out(nothing, tasks, Path(folder), workers=workers)]
    steady = ends[-1] - ends[0]
    return {"start_s": ends[0] - begun, "seconds": steady, "ms_per_task": 1000 * steady / (count - 1)}


def solved(config: Path, count: int, workers: int | str) -> dict[str, float]:
    """Items per minute of a batch of solves, from the tenth that ends to the last, and what that takes here.

    With workers that is the process that asks, in which Dask's scheduler is, too.
    """
    grid = {"render.seed": list(range(count))}
    ends: list[float] = []
    busy: list[float] = []

    def ended(_: ItemResult) -> None:
        ends.append(time.perf_counter())
        busy.append(time.process_time())

    with tempfile.TemporaryDirectory() as folder:
        run_batch(
            make_items([config], grid=grid),
            folder,
            workers=workers,
            solve_only=True,
            on_result=ended,
        )
    first = min(10, count // 2)
    items = count - 1 - first
    return {
        "items_per_minute": 60 * items / (ends[-1] - ends[first]),
        "cpu_ms_per_item_here": 1000 * (busy[-1] - busy[first]) / items,
    }


def bytes_per_item(config: Path) -> dict[str, int]:
    """What a worker is sent for an item, and what it answers."""
    (item,) = make_items([config])
    task = task_of(item, Fingerprints().of(item.config, solve_only=True))
    sent = (attempt, DoItem(Path("/a/folder/of/results"), True), task, Journal(Path("/a/folder"), "0" * 12))
    return {"sent": len(pickle.dumps(sent))}


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", type=int, default=1000, help="that do nothing")
    parser.add_argument(
        "--workers",
        type=lambda text: int(text) if text.isdecimal() else text,
        nargs="+",
        default=[1, 2],
        help="numbers of processes, or addresses of schedulers",
    )
    parser.add_argument("--config", type=Path, help="whose items are solved")
    parser.add_argument("--items", type=int, default=100, help="of the config")
    arguments = parser.parse_args()
    for workers in arguments.workers:
        print(json.dumps({"tasks": arguments.tasks, "workers": workers} | timed(arguments.tasks, workers)))
    if arguments.config is None:
        return
    print(json.dumps(bytes_per_item(arguments.config)))
    for workers in arguments.workers:
        found = solved(arguments.config, arguments.items, workers)
        print(json.dumps({"items": arguments.items, "workers": workers} | found), flush=True)


if __name__ == "__main__":
    main()
