"""How long commands take in a fresh process: the first time, again, and after a wish has changed.

Every command starts with an empty cache of its own, and writes to a folder that is removed. Nothing else is
to run beside it.

    python scripts/bench_commands.py [--only NAME ...] [--repeat 3] [--json FILE]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMMANDS = {
    "still life": ("run configs/still_life.toml", "run configs/still_life.toml --set focus.1.blur_px=25"),
    "rack focus, 4 frames": ("shot configs/rack_focus.toml --frames 1,2,3,4", None),
    "two actors, 2 frames": ("shot configs/two_actors.toml --frames 23,24", None),
    "focus through glass": ("solve configs/dome_glass.toml", None),
}


def seconds(command: str, cache: Path) -> float:
    """Wall-clock seconds of the whole process."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    with tempfile.TemporaryDirectory() as out:
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "focusjax", *command.split(), "--out", str(Path(out) / "out")],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
        )
        taken = time.perf_counter() - start
    if done.returncode not in (0, 3):
        raise SystemExit(f"focusjax {command} failed:\n{done.stderr}")
    return taken


def main() -> None:
    """Measure, print, and write the figures down."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS), metavar="NAME")
    parser.add_argument("--repeat", type=int, default=3, help="how often again; the least is reported")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table = {}
    for name in options.only:
        command, changed = COMMANDS[name]
        with tempfile.TemporaryDirectory() as cache:
            first = seconds(command, Path(cache))
            again = min(seconds(command, Path(cache)) for _ in range(options.repeat))
            other = seconds(changed, Path(cache)) if changed else None
        table[name] = {"first": first, "again": again, "changed": other}
        print(f"{name:22} first {first:6.1f} s, again {again:6.1f} s", end="")
        print(f", a wish changed {other:6.1f} s" if other else "", flush=True)
    if options.json:
        options.json.write_text(json.dumps(table, indent=2))


if __name__ == "__main__":
    main()
