"""How quickly a data set is made: pictures per minute by one process of one core, and what compiling takes.

    python scripts/bench_dataset.py                          # 100 pictures of 256 x 256, the default spec
    python scripts/bench_dataset.py --spec SPEC --count 1000
    taskset -c 0 python scripts/bench_dataset.py             # where the process has several cores

Prints a line of JSON. Programs are compiled anew, as in a process that has no cache of them; how many is
counted. The time of pictures is without the first `--warm`, and includes writing them.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("NPROC", "1")
os.environ.setdefault("JAX_ENABLE_COMPILATION_CACHE", "0")

import jax
import numpy as np

from focusjax import _parallel
from focusjax.dataset import Spec, load_spec, make_dataset, spec_of
from focusjax.dataset._folder import save_arrays
from focusjax.dataset._picture import make_picture


class Compiled:
    """Counts programs that are compiled, and their seconds."""

    def __init__(self) -> None:
        self.count, self.seconds = 0, 0.0
        jax.monitoring.register_event_duration_secs_listener(self._listen)

    def _listen(self, event: str, seconds: float, **_about: object) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            self.count, self.seconds = self.count + 1, self.seconds + seconds


def measured(spec: Spec, count: int, warm: int) -> dict[str, float]:
    """Seconds of the first pictures and of those after them, each written to a file."""
    compiled, seconds, before = Compiled(), [], 0
    files = spec.mesh_files
    with tempfile.TemporaryDirectory() as folder:
        for number in range(warm + count):
            if number == warm:
                before = compiled.count
            begun = time.perf_counter()
            save_arrays(Path(folder) / f"{number}.npz", make_picture(spec, number, files).arrays)
            seconds.append(time.perf_counter() - begun)
        written = sum(path.stat().st_size for path in Path(folder).iterdir()) / (warm + count)
    return {
        "pictures_per_minute": 60.0 / float(np.mean(seconds[warm:])),
        "median_s": float(np.median(seconds[warm:])),
        "first_pictures_s": float(np.sum(seconds[:warm])),
        "compile_s": compiled.seconds,
        "programs": before,
        "programs_later": compiled.count - before,
        "bytes_per_picture": written,
    }


def shared(spec: Spec, count: int, workers: int) -> dict[str, float]:
    """Seconds of a whole run by several processes, compiling and starting them included."""
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        make_dataset(spec, count, Path(folder) / "out", workers=workers)
        return {"workers": workers, "seconds": time.perf_counter() - begun}


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spec", type=Path, help="TOML file; the defaults if left out")
    parser.add_argument("--count", type=int, default=100, help="pictures that are timed")
    parser.add_argument("--warm", type=int, default=10, help="pictures before them, which compile")
    parser.add_argument("--workers", type=int, help="also time a whole run by so many processes")
    arguments = parser.parse_args()
    _parallel.use_cores(1)
    spec = spec_of({}) if arguments.spec is None else load_spec(arguments.spec)
    size = {"resolution": list(spec.camera.resolution), "count": arguments.count}
    print(json.dumps(size | measured(spec, arguments.count, arguments.warm)), flush=True)
    if arguments.workers is not None:
        print(json.dumps(size | shared(spec, arguments.count, arguments.workers)))


if __name__ == "__main__":
    main()
