"""Files and settings gone wrong, by chance: what focusjax does must be a picture or a sentence.

Every run has a seed of its own. It takes a small config (a still, one with a film or a sensor, or a shot of
two frames), a mesh, a lens file, a glass catalogue, a database of lenses, a photograph, a camera file or a
batch table, changes one to three things in it, and runs the command that reads it, in this process; or it
makes edits as the studio's page does. Counted as findings are

- exceptions that nobody turned into a sentence, and exit statuses that are none of ours;
- pictures and reports with numbers that are not finite;
- folders that are there although the command failed, or not there although it did not;
- runs over the limits of time and memory.

    python scripts/fuzz.py --runs 5000
    python scripts/fuzz.py --only 1234
    python scripts/fuzz.py --runs 200 --kinds bad_glass bad_shot

A seed chooses among the kinds that are given, so that `--only` needs the same `--kinds` again.

The exit status is 1 if anything is found.
"""

import dataclasses
import faulthandler
import json
import shutil
import signal
import tempfile
import traceback
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _command_line import make_parser
from _fuzz_inputs import folder_with_inputs
from _fuzz_kinds import KINDS, Kind, bad_batch, bad_shot, studio_edits
from _fuzz_studio import edit
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.io import load_exr

SECONDS = 90
GIBIBYTES = 2.0
STATUSES = {0: "made", 1: "failed", 2: "refused", 3: "missed"}


@dataclasses.dataclass(frozen=True)
class Ended:
    """What became of a command: its exit status, what nobody caught, and what it said."""

    exit_code: int
    exception: BaseException | None
    output: str


class TookTooLongError(Exception):
    """A run over its time."""


def run(command: list[str]) -> Ended:
    """Run a command line of focusjax."""
    result = CliRunner().invoke(app, command)
    return Ended(result.exit_code, result.exception, result.output)


def edited(path: str, seed: str) -> Ended:
    """What became of edits, as of a command."""
    try:
        return Ended(edit(path, seed), None, "")
    except Exception as error:
        return Ended(1, error, str(error))


def not_finite(folder: Path) -> list[str]:
    """Pictures and reports in a folder that have numbers that are not finite."""
    found = []
    for path in folder.rglob("*.exr"):
        colours = [values for name, values in load_exr(path).items() if name != "Z"]
        if not all(np.isfinite(values).all() for values in colours):
            found.append(path.name)
    for path in folder.rglob("*.json"):
        # "inf" is a distance as text; the bare words are no JSON.
        json.loads(
            path.read_text(), parse_constant=lambda word, path=path: found.append(f"{path.name}: {word}")
        )
    return found


def peak() -> int:
    """Most bytes of memory that this process has held since `forgotten_peak`."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def forgotten_peak() -> int:
    """Bytes of memory that this process holds, from which on its peak counts anew."""
    Path("/proc/self/clear_refs").write_text("5")
    return peak()


def left_behind(kind: Kind, result: Ended, out: Path) -> list[str]:
    """Names of what is in the folder of a command that failed, and should not be there."""
    # Items of a batch are whole each, and so are frames of a shot, which goes on where it was.
    if result.exit_code not in (1, 2) or not out.exists() or kind is bad_batch:
        return []
    kept = {"frames"} if kind is bad_shot and result.exit_code == 1 else set()
    return sorted({path.name for path in out.iterdir()} - kept)


def one_run(seed: int, inputs: Path, folder: Path, kinds: Sequence[Kind]) -> tuple[str, list[str]]:
    """Kind and outcome of a run, and what is wrong with it."""
    rng = np.random.default_rng(seed)
    shutil.copytree(inputs, folder)
    kind = kinds[rng.integers(len(kinds))]
    command = kind(folder, rng)
    # Paths of the command are in the folder.
    command = [str(folder / part) if (folder / part).is_file() else part for part in command]
    out = folder / "out"
    command = [part.replace("out/c.", f"{out}/c.") for part in command]
    command += [] if "--out" in command else ["--out", str(out)]
    before = forgotten_peak()

    def stop(*_: Any) -> None:
        raise TookTooLongError(f"took more than {SECONDS} s")

    signal.signal(signal.SIGALRM, stop)
    signal.alarm(SECONDS)
    # Compiled code does not let the alarm in: what hangs there ends this process.
    faulthandler.dump_traceback_later(3 * SECONDS, exit=True)
    try:
        result = edited(*command[:2]) if kind is studio_edits else run(command)
    finally:
        signal.alarm(0)
        faulthandler.cancel_dump_traceback_later()
    wrong = []
    grown = (peak() - before) / 2**30
    if grown > GIBIBYTES:
        wrong.append(f"memory grew by {grown:.1f} GiB")
    said = result.output
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        wrong.append("".join(traceback.format_exception(result.exception)[-3:]))
    elif result.exit_code not in STATUSES:
        wrong.append(f"exit status {result.exit_code}")
    if "internal error" in said or "Traceback" in said or TookTooLongError.__name__ in said:
        wrong.append(" ".join(said.split())[-600:])
    made = out.exists() and any(out.iterdir())
    if left := left_behind(kind, result, out):
        wrong.append(f"failed ({' '.join(said.split())[-200:]}), and {left} is there")
    if result.exit_code in (0, 3) and not made and kind is not studio_edits:
        wrong.append("nothing was written")
    wrong += not_finite(out) if made else []
    return f"{kind.__name__}: {STATUSES.get(result.exit_code, 'other')}", wrong


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first run")
    parser.add_argument("--only", type=int, nargs="+", help="seeds to run alone")
    names = {kind.__name__: kind for kind in KINDS}
    parser.add_argument("--kinds", nargs="+", choices=names, metavar="KIND", help=", ".join(names))
    options = parser.parse_args()
    kinds = KINDS if options.kinds is None else [names[name] for name in options.kinds]
    seeds = options.only or range(options.first, options.first + options.runs)
    outcomes: Counter[str] = Counter()
    findings = 0
    with tempfile.TemporaryDirectory() as place:
        inputs = Path(place) / "inputs"
        inputs.mkdir()
        folder_with_inputs(inputs)
        for seed in seeds:
            folder = Path(place) / f"run{seed}"
            outcome, wrong = one_run(seed, inputs, folder, kinds)
            shutil.rmtree(folder)
            outcomes[outcome] += 1
            findings += bool(wrong)
            for each in wrong:
                print(f"seed {seed}, {outcome}: {each}", flush=True)
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:6d}  {outcome}")
    print(f"{sum(outcomes.values())} runs, {findings} with findings")
    raise SystemExit(findings > 0)


if __name__ == "__main__":
    main()
