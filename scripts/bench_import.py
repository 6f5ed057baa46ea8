"""Seconds that importing focusjax and the first words of its command line take, each in new processes.

The least of several runs counts: it is what the work takes when nothing else is in the way.
"""

import argparse
import subprocess
import sys
import time

STATEMENTS = {
    "python alone": "pass",
    "import jax": "import jax",
    "import focusjax": "import focusjax",
    "import focusjax, and every public name": "from focusjax import *",
}
COMMANDS = ("--help", "run --help", "--version")
_CALL = "import sys; sys.argv[1:] = {words}; from focusjax.cli import main; main()"


def seconds(code: str, runs: int) -> float:
    """The least time of `runs` processes that run `code`; the start of Python is in it."""
    best = float("inf")
    for _ in range(runs + 1):
        # The first run fills the caches of the disk and of compiled modules.
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, check=True)
        best = min(best, time.perf_counter() - start)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5, help="processes for each line")
    runs = parser.parse_args().runs
    calls = {f"focusjax {words}": _CALL.format(words=words.split()) for words in COMMANDS}
    for name, code in (STATEMENTS | calls).items():
        print(f"{name:40} {seconds(code, runs):.2f} s")


if __name__ == "__main__":
    main()
