"""How the time of peeling falls with the cores that it may use.

    python scripts/bench_peel_cores.py
    JAX_PLATFORMS=cpu python scripts/bench_peel_cores.py --cores 1 2 4 8 16 --scenes scan-2

Peels the scenes of `compare_denoised.py`, warm; the median of several turns.
"""

import argparse
import statistics
import time

import equinox as eqx
import jax
from _compared_scenes import SCENES
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
        scene, camera, lens = SCENES[name]()
        for cores in options.cores:
            _parallel.use_cores(cores)
            seconds = []
            for _ in range(1 + options.repeats):
                begun = time.perf_counter()
                layers = peel(scene, camera, lens)
                jax.block_until_ready(eqx.filter(layers, eqx.is_array))
                seconds.append(time.perf_counter() - begun)
            table.add_row(name, str(cores), f"{statistics.median(seconds[1:]):.3f}", f"{seconds[0]:.3f}")
    Console().print(table)


if __name__ == "__main__":
    main()
