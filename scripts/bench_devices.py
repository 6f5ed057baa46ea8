"""How tracing time falls with devices, and with processes of `jax.distributed`, on the cores of this machine.

Every case runs in processes of their own that may use so many cores each: one host device on one core, one on
two (which then traces two blocks at a time), two host devices on two cores, and two processes of one core
and one device each. All make the same picture of `--triangles` at `--size`, warm.

    python scripts/bench_devices.py
"""

import argparse
import json
import os
import socket
import subprocess
import sys

CASES = {
    "1 device, 1 core": (1, 1, 1),
    "1 device, 2 cores": (1, 1, 2),
    "2 devices, 2 cores": (1, 2, 2),
    "2 processes of 1 core": (2, 1, 1),
}
"""Processes, and devices and cores of each."""


def one_process(options: argparse.Namespace) -> None:
    """Makes the picture as one of the processes of a case, and prints seconds."""
    cores = sorted(os.sched_getaffinity(0))
    first = options.rank * options.cores
    os.sched_setaffinity(0, cores[first : first + options.cores])
    import jax

    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_num_cpu_devices", options.devices)
    if options.processes > 1:
        address = f"localhost:{options.port}"
        jax.distributed.initialize(address, num_processes=options.processes, process_id=options.rank)

    from _procedural import view
    from _timing import timed
    from bench_layers import balls

    from focusjax.layers import peel
    from focusjax.trace import render

    width, height = map(int, options.size.split("x"))
    camera, lens = view(width, height)
    layers = peel(balls(options.triangles), camera, lens, supersampling=1)
    made = timed(lambda: render(layers, lens, rays=options.rays, devices=jax.devices()), options.repeats)
    print(json.dumps({"first": made.first, "warm": made.median, "mean": float(made.result.mean())}))


def measured(options: argparse.Namespace, processes: int, devices: int, cores: int) -> dict[str, float]:
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    command = [sys.executable, __file__, "--size", options.size, "--rays", str(options.rays)]
    command += ["--triangles", str(options.triangles), "--repeats", str(options.repeats), "--port", str(port)]
    command += ["--processes", str(processes), "--devices", str(devices), "--cores", str(cores)]
    running = [
        subprocess.Popen([*command, "--rank", str(rank)], stdout=subprocess.PIPE, text=True)
        for rank in range(processes)
    ]
    out = [process.communicate()[0] for process in running]
    if any(process.returncode for process in running):
        raise SystemExit(f"a process of {processes} failed; see above")
    return json.loads(out[0].splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--size", default="800x600", metavar="WIDTHxHEIGHT")
    parser.add_argument("--triangles", type=int, default=100_000)
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=3)
    for name in ("processes", "devices", "cores", "rank", "port"):
        parser.add_argument(f"--{name}", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.rank is not None:
        one_process(options)
        return
    rows = {name: measured(options, *case) for name, case in CASES.items()}
    slowest = rows["1 device, 1 core"]["warm"]
    for name, row in rows.items():
        times = f"{slowest / row['warm']:.2f} times as quick"
        print(
            f"{name:>22}: {row['warm']:6.2f} s warm ({row['first']:.1f} s first), {times}, {row['mean']:.6f}"
        )


if __name__ == "__main__":
    main()
