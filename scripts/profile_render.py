"""Which lines of the tracer take the time of a warm picture.

    python scripts/profile_render.py --rays 16
    python scripts/profile_render.py --scene leaves-2 --rays 4 --ops

XLA fuses operations of many lines into one, and names one of them: times are of all that was fused with it. A
fusion that several cores share counts once. Needs a processor: on a GPU other tools say more.
"""

import collections
import gzip
import json
import os
import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import jax
from _command_line import make_parser
from _compared_scenes import SCENES
from rich.console import Console
from rich.table import Table

from focusjax.layers import peel
from focusjax.trace import render


def main() -> None:
    """Measure, and print."""
    parser = make_parser(__doc__)
    parser.add_argument("--scene", choices=list(SCENES), default="scan-1")
    parser.add_argument("--rays", type=int, default=16)
    parser.add_argument("--rows", type=int, default=30, help="of the table")
    parser.add_argument("--ops", action="store_true", help="one row for each operation of XLA's")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        # Read when the first program is compiled.
        dump = f"--xla_dump_to={folder}/programs --xla_dump_hlo_as_text --xla_dump_hlo_module_re=.*picture.*"
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {dump}"
        scene, camera, lens = SCENES[options.scene]()
        layers = peel(scene, camera, lens)
        jax.block_until_ready(render(layers, lens, rays=options.rays))
        settings = jax.profiler.ProfileOptions()
        settings.host_tracer_level, settings.python_tracer_level = 2, 0
        jax.profiler.start_trace(folder, create_perfetto_trace=True, profiler_options=settings)
        begun = time.perf_counter()
        jax.block_until_ready(render(layers, lens, rays=options.rays))
        seconds = time.perf_counter() - begun
        jax.profiler.stop_trace()
        own, calls = own_times(next(Path(folder).rglob("perfetto_trace.json.gz")))
        texts = Path(folder, "programs").glob("*picture*cpu_after_optimizations.txt")
        lines = lines_of(max(texts, key=lambda path: path.stat().st_size).read_text())
    headings = ("ms", "calls", "operation", "line") if options.ops else ("ms", "calls", "line")
    table = Table(*headings, title=f"{options.scene}, {options.rays} rays: {seconds:.3f} s with the profiler")
    for name, microseconds, count in totals(own, calls, lines, by_operation=options.ops)[: options.rows]:
        table.add_row(f"{microseconds / 1e3:.1f}", str(count), *name)
    Console().print(table)


def totals(
    own: dict[str, float], calls: dict[str, int], lines: dict[str, str], *, by_operation: bool
) -> list[tuple[tuple[str, ...], float, int]]:
    """Names, microseconds and calls, the longest first."""
    time_of: dict[tuple[str, ...], float] = collections.defaultdict(float)
    calls_of: dict[tuple[str, ...], int] = collections.defaultdict(int)
    for operation, line in lines.items():
        if operation in own:
            name = (operation, line) if by_operation else (line,)
            time_of[name] += own[operation]
            calls_of[name] += calls[operation]
    return sorted(((name, spent, calls_of[name]) for name, spent in time_of.items()), key=lambda row: -row[1])


def own_times(trace: Path) -> tuple[dict[str, float], dict[str, int]]:
    """Microseconds of each operation without those inside it, and calls."""
    content = json.loads(gzip.decompress(trace.read_bytes()))
    events = content["traceEvents"] if isinstance(content, dict) else content
    threads = collections.defaultdict(list)
    for event in events:
        if event.get("ph") == "X":
            threads[event["pid"], event["tid"]].append((event["ts"], -event.get("dur", 0.0), event["name"]))
    own: dict[str, float] = collections.defaultdict(float)
    calls: dict[str, int] = collections.defaultdict(int)
    for spans in threads.values():
        around: list[tuple[float, str]] = []
        for begin, minus, name in sorted(spans):
            while around and around[-1][0] <= begin:
                around.pop()
            own[name] -= minus
            calls[name] += 1
            if around:
                own[around[-1][1]] += minus
            around.append((begin - minus, name))
    return own, calls


def lines_of(text: str) -> dict[str, str]:
    """File and line of the package that each operation of a compiled program comes from."""
    tables = ("FileNames", "FileLocations", "StackFrames")
    files, places, frames = (dict(_numbered(text, name)) for name in tables)

    def number(row: str, key: str) -> int:
        found = re.search(rf"{key}=(\d+)", row)
        return int(found[1]) if found else 0

    def line(frame: int) -> str:
        while frame:
            place, above = (number(frames[frame], key) for key in ("file_location_id", "parent_frame_id"))
            name = files[number(places[place], "file_name_id")].strip('"')
            _, inside, name = name.rpartition("/focusjax/")
            if inside:
                return f"{name}:{number(places[place], 'line')}"
            frame = 0 if above == frame else above
        return "?"

    found = {}
    for operation, rest in re.findall(r"^\s*(?:ROOT )?%([\w.\-]+) = (.*)$", text, re.MULTILINE):
        frame = re.search(r"stack_frame_id=(\d+)", rest)
        found.setdefault(operation, line(int(frame[1])) if frame else "?")
    return found


def _numbered(text: str, name: str) -> Iterator[tuple[int, str]]:
    """The rows of one of the tables that a program's text begins with."""
    table = re.search(rf"^{name}\n((?:\d+ .*\n)+)", text, re.MULTILINE)
    for row in table[1].splitlines() if table else ():
        number, _, content = row.partition(" ")
        yield int(number), content


if __name__ == "__main__":
    main()
