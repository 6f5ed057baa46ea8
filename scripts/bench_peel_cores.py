"""How the time of peeling falls with the cores that it may use.

    python scripts/bench_peel_cores.py
    JAX_PLATFORMS=cpu python scripts/bench_peel_cores.py --cores 1 2 4 8 16 --scenes scan-2

Peels the scenes of `compare_denoised.py`, warm; the median of several turns.
"""

import argparse
import functools

from _compared_scenes import SCENES
from _timing import timed
from rich.console import Console
from rich.table import Table

from focusjax import _parallel
from focusjax.layers import peel


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cores", type=int, nargs="+", default=[1, _parallel.CORES])
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=["scan-2", "leaves-2"])
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    table = Table("scene", "cores", "seconds", "first")
    for name in options.scenes:
        compared = SCENES[name]()
        for cores in options.cores:
            _parallel.use_cores(cores)
            found = timed(functools.partial(peel, *compared), options.repeats)
            table.add_row(name, str(cores), f"{found.median:.3f}", f"{found.first:.3f}")
    Console().print(table)


if __name__ == "__main__":
    main()
