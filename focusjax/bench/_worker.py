"""A process that measures one method, or makes a reference, and ends.

Every method has a process of its own, so that its memory is its own, and so that a library that takes its
process down takes nothing else with it. Called as `python -m focusjax.bench._worker TASK FOLDER`: what to do
is in the JSON file TASK, results go to FOLDER.
"""

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from focusjax._console import sentence
from focusjax.bench._case import Case, load_case
from focusjax.bench._makers import maker_named
from focusjax.bench._measure import Measured, Timing, measure
from focusjax.bench._methods import Method, method_named

ROOT = Path(__file__).parents[2]


def measured_apart(
    method: Method, case: Case, *, repeats: int
) -> tuple[Measured | None, list[np.ndarray], str | None]:
    """`measure` in a process of its own: the result, and the picture [h, w, 3] of each setting.

    A method that fails keeps the settings that it was done with; the last of the three is what it said then.
    """
    task = {"method": method.name, "settings": list(method.settings), "repeats": repeats}
    failure = None
    with tempfile.TemporaryDirectory(prefix="focusjax-") as folder:
        try:
            _run(task, case, Path(folder))
        except ValueError as error:
            failure = str(error)
        file = Path(folder) / "measured.json"
        if not file.exists():
            return None, [], failure
        found = json.loads(file.read_text())
        timings = tuple(Timing(**timing) for timing in found.pop("timings"))
        pictures = [_picture(Path(folder), number) for number in range(len(timings))]
    return Measured(**found, timings=timings), pictures, failure


def made_apart(maker: str, case: Case, parts: Sequence[tuple[int, int]]) -> list[tuple[np.ndarray, int]]:
    """What the maker returns for each (samples, seed) of `parts`.

    Raises:
        ValueError: the maker failed; the message is what it said last.
    """
    with tempfile.TemporaryDirectory(prefix="focusjax-") as folder:
        _run({"maker": maker, "parts": list(parts)}, case, Path(folder))
        dropped = json.loads((Path(folder) / "dropped.json").read_text())
        return [(_picture(Path(folder), number), count) for number, count in enumerate(dropped)]


def _run(task: dict[str, Any], case: Case, folder: Path) -> None:
    case.save(folder / "case.npz")
    (folder / "task.json").write_text(json.dumps(task))
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-m", "focusjax.bench._worker", str(folder / "task.json"), str(folder)],
        # What runs is the program that was asked, wherever it was asked from.
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        why = lines[-1].strip() if lines else f"its process ended with status {done.returncode}"
        raise ValueError(f"{task.get('method') or task['maker']} failed on {case.name}: {why}")


def _picture_file(folder: Path, number: int) -> Path:
    return folder / f"picture_{number}.npy"


def _picture(folder: Path, number: int) -> np.ndarray:
    return np.load(_picture_file(folder, number)).astype(np.float64)


def main(task_file: Path, folder: Path) -> None:
    """Do what the task says."""
    task = json.loads(task_file.read_text())
    case = load_case(folder / "case.npz")

    def keep(number: int, picture: np.ndarray) -> None:
        np.save(_picture_file(folder, number), picture.astype(np.float32))

    if "maker" in task:
        dropped = []
        for number, (samples, seed) in enumerate(task["parts"]):
            picture, count = maker_named(task["maker"])(case, samples, seed)
            keep(number, picture)
            dropped.append(count)
        (folder / "dropped.json").write_text(json.dumps(dropped))
        return
    method = dataclasses.replace(method_named(task["method"]), settings=tuple(task["settings"]))

    def note(measured: Measured) -> None:
        # Renamed, so that it is never there in part.
        (folder / "unfinished.json").write_text(json.dumps(dataclasses.asdict(measured)))
        (folder / "unfinished.json").replace(folder / "measured.json")

    measure(method, case, repeats=task["repeats"], keep=keep, note=note)


if __name__ == "__main__":
    # Compiling is measured, so that programs kept from earlier runs would make it too short.
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    except Exception as error:
        # The process that asked reads the last line.
        sys.stderr.write(f"\n{sentence(error)}\n")
        sys.exit(1)
