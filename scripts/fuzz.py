"""Files and settings gone wrong, by chance: what focusjax does must be a picture or a sentence.

Every run has a seed of its own. It takes a small config, a mesh, a lens file, a photograph, a camera file or
a batch table, changes one to three things in it, and runs the command that reads it, in this process; or it
makes edits as the studio's page does. Counted as findings are

- exceptions that nobody turned into a sentence, and exit statuses that are none of ours;
- pictures and reports with numbers that are not finite;
- folders that are there although the command failed, or not there although it did not;
- runs over the limits of time and memory.

    python scripts/fuzz.py --runs 5000
    python scripts/fuzz.py --only 1234

The exit status is 1 if anything is found.
"""

import argparse
import dataclasses
import faulthandler
import json
import math
import re
import shutil
import signal
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
import trimesh
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.io import load_exr, save_png
from focusjax.studio import EditError, Session
from focusjax.studio._wishes import KINDS as WISHES

SECONDS = 90
GIBIBYTES = 2.0
STATUSES = {0: "made", 1: "failed", 2: "refused", 3: "missed"}

CONFIG = """
title = "boxes"
[scene]
ambient = 0.3
background = {kind = "gradient", bottom = 0.1, horizon = 0.5, top = [0.2, 0.4, 0.9]}
[[scene.lights]]
kind = "directional"
direction = [1, -1, -1]
[[scene.objects]]
file = "box.ply"
name = "near"
translate = [-0.4, 0, -2]
colour = [0.9, 0.3, 0.2]
[[scene.objects]]
file = "box.glb"
name = "far"
translate = [1.0, 0, -5]
specular = 0.3
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
focal_length_mm = 50
resolution = [16, 12]
[lens]
f_number = 2.0
focus_distance_m = 4.0
aperture = {shape = "polygon", blades = 6}
[[focus]]
name = "front"
point = [-0.4, 0, -1.75]
sharp = true
[[focus]]
object = "far"
at_least_px = 1
weight = 2
[[focus]]
pixel = [4, 5]
blur_px = 1
[solve]
free = ["focus", "f_number"]
f_number_min = 0.5
[render]
rays = 4
supersampling = 1
"""

CAMERA = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Xform "rig"
{
    double3 xformOp:translate = (10, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Camera "hero"
    {
        float focalLength = 35
        float horizontalAperture = 24
        float focusDistance = 150
        float fStop = 2.8
        double3 xformOp:translate = (0, 0, 200)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""

ODD_VALUES = (
    *(0, -1, 1, 2, 7, 1e-30, 1e39, -1e39, 1e300, 2**40, 0.5, -0.5, 1e-6, 1e6, 89.9, 360),
    *(
        math.nan,
        math.inf,
        -math.inf,
        True,
        False,
        "",
        "x",
        "near",
        "far",
        "box.ply",
        "../../etc/passwd",
        "[/b]",
    ),
    *(
        [],
        [0],
        [0, 0],
        [0, 0, 0],
        [1, 2, 3],
        [math.nan] * 3,
        [1e20] * 3,
        [[1, 0, 0, 0]] * 4,
        {},
        {"kind": "x"},
    ),
)


@dataclasses.dataclass(frozen=True)
class Ended:
    """What became of a command: its exit status, what nobody caught, and what it said."""

    exit_code: int
    exception: BaseException | None
    output: str


class TookTooLongError(Exception):
    """A run over its time."""


def folder_with_inputs(folder: Path) -> None:
    """Everything that runs start from, as it should be."""
    (folder / "boxes.toml").write_text(CONFIG)
    box = trimesh.creation.box((0.5, 0.5, 0.5))
    for ending in ("ply", "glb", "obj", "stl"):
        box.export(folder / f"box.{ending}")
    rng = np.random.default_rng(5)
    save_png(folder / "photo.png", rng.uniform(0, 1, (12, 16, 3)))
    np.save(folder / "depth.npy", np.repeat([[2.0] * 8 + [4.0] * 8], 12, axis=0))
    for lens in (resources.files("focusjax") / "optics" / "data" / "lenses").iterdir():
        (folder / lens.name).write_bytes(lens.read_bytes())
    (folder / "table.csv").write_text("lens.f_number,focus.2.blur_px\n2,1\n4,2\n")
    (folder / "camera.usda").write_text(CAMERA)


def odd(rng: np.random.Generator) -> Any:
    value = ODD_VALUES[rng.integers(len(ODD_VALUES))]
    return float(rng.normal(0, 10)) if rng.random() < 0.2 else value


def nearby(value: Any, rng: np.random.Generator) -> Any:
    """What another might have written there: the same kind, some times as large, or of the other sign."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return str(rng.choice([each for each in ODD_VALUES if isinstance(each, str)]))
    if isinstance(value, list):
        return [nearby(each, rng) if rng.random() < 0.5 else each for each in value]
    if not isinstance(value, int | float):
        return odd(rng)
    changed = -value if rng.random() < 0.2 else value * 10.0 ** rng.normal(0, 0.7)
    return round(changed) if isinstance(value, int) and rng.random() < 0.8 else float(changed)


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every key and index within tables and arrays."""
    inside = (
        list(node.items())
        if isinstance(node, dict)
        else list(enumerate(node))
        if isinstance(node, list)
        else []
    )
    return [each for key, value in inside for each in ((*path, key), *places(value, (*path, key)))]


def changed_config(folder: Path, rng: np.random.Generator, extra: dict[str, Any] | None = None) -> list[str]:
    """Values of the config replaced, removed or repeated."""
    data = tomlkit.parse(CONFIG).unwrap() | (extra or {})
    for _ in range(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15])):
        path = [*places(data)][rng.integers(len(places(data)))]
        parent = data
        for key in path[:-1]:
            parent = parent[key]
        act = rng.random()
        if act < 0.7:
            parent[path[-1]] = nearby(parent[path[-1]], rng)
        elif act < 0.85:
            parent[path[-1]] = odd(rng)
        elif act < 0.95:
            del parent[path[-1]]
        elif isinstance(parent, list):
            parent.append(parent[path[-1]])
        else:
            parent[f"{path[-1]}s"] = odd(rng)
        if not places(data):
            break
    (folder / "boxes.toml").write_text(tomlkit.dumps(data))
    return [str(["run", "solve", "render"][rng.integers(3)]), "boxes.toml"]


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes flipped, left out, repeated, or cut off; numbers in text replaced."""
    act = rng.random()
    if act < 0.35:
        found = list(re.finditer(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?", data[: 1 << 16]))
        if found:
            one = found[rng.integers(len(found))]
            number = [b"0", b"-1", b"nan", b"inf", b"1e39", b"1e-39", b"99999999999", b"x"][rng.integers(8)]
            return data[: one.start()] + number + data[one.end() :]
    if act < 0.5:
        return data[: rng.integers(len(data) + 1)]
    start = int(rng.integers(len(data)))
    end = min(len(data), start + int(rng.integers(1, 64)))
    if act < 0.65:
        return data[:start] + data[end:]
    if act < 0.8:
        return data[:start] + data[start:end] * 2 + data[end:]
    noise = rng.integers(0, 256, end - start, dtype=np.uint8).tobytes()
    return data[:start] + noise + data[end:]


def damage(path: Path, rng: np.random.Generator) -> None:
    data = path.read_bytes()
    for _ in range(rng.integers(1, 3)):
        data = damaged(data, rng) if data else b"\0"
    path.write_bytes(data)


def bad_text(folder: Path, rng: np.random.Generator) -> list[str]:
    damage(folder / "boxes.toml", rng)
    return ["solve", "boxes.toml"]


def bad_mesh(folder: Path, rng: np.random.Generator) -> list[str]:
    name = ["box.ply", "box.glb", "box.obj", "box.stl"][rng.integers(4)]
    damage(folder / name, rng)
    return ["run", "boxes.toml", "--set", f"scene.objects.1.file={name}"]


def bad_lens(folder: Path, rng: np.random.Generator) -> list[str]:
    names = sorted(path.name for path in folder.iterdir() if path.suffix in (".zmx", ".json", ".dat"))
    name = names[rng.integers(len(names))]
    damage(folder / name, rng)
    return ["lens", name]


def bad_photo(folder: Path, rng: np.random.Generator) -> list[str]:
    if rng.random() < 0.5:
        damage(folder / ["photo.png", "depth.npy"][rng.integers(2)], rng)
    else:
        depth = np.load(folder / "depth.npy")
        depth[rng.integers(12), rng.integers(16)] = rng.choice([0, -1, np.nan, np.inf, 1e-30, 1e30, 1e39])
        np.save(folder / "depth.npy", depth if rng.random() < 0.7 else depth[: rng.integers(0, 12)])
    place = f"{rng.integers(-2, 20)},{rng.integers(-2, 16)}"
    options = ["--depth", "depth.npy", "--depth-unit", str(rng.choice(["m", "mm", "1/m"]))]
    length = str(rng.choice(["26", "0", "-1", "nan", "1e9", "50"], p=[0.6, 0.05, 0.05, 0.05, 0.05, 0.2]))
    return [
        "refocus",
        "photo.png",
        *options,
        "--sharp",
        place,
        "--f-number",
        "2",
        "--focal-length-35mm",
        length,
    ]


def bad_camera(folder: Path, rng: np.random.Generator) -> list[str]:
    damage(folder / "camera.usda", rng)
    text = CONFIG.replace(
        "position = [0, 0, 0]\nlook_at = [0, 0, -1]\nfocal_length_mm = 50\n", "file='camera.usda'\n"
    )
    (folder / "boxes.toml").write_text(text)
    return ["render", "boxes.toml"]


def bad_batch(folder: Path, rng: np.random.Generator) -> list[str]:
    damage(folder / "table.csv", rng)
    return ["batch", "boxes.toml", "--table", "table.csv"]


def bad_export(folder: Path, rng: np.random.Generator) -> list[str]:
    command = changed_config(folder, rng)
    targets = {"usd": "usda", "blender": "py", "mitsuba": "xml", "pbrt": "pbrt", "gltf": "gltf"}
    target = list(targets)[rng.integers(len(targets))]
    return ["export", command[1], "--to", target, "--approximate", "--out", f"out/c.{targets[target]}"]


def studio_edits(folder: Path, rng: np.random.Generator) -> list[str]:
    """Nothing to damage: `edit` does what a person does on the page."""
    return [str(folder / "boxes.toml"), str(rng.integers(1 << 30))]


def edit(path: str, seed: str) -> int:
    """Up to eight edits of a config, each solved or refused; then it is saved, and says the same when read.

    Returns:
        the exit status that a command would have: 0, or 2 if every edit was refused.
    """
    rng = np.random.default_rng(int(seed))
    session = Session(path)
    taken = 0
    for _ in range(rng.integers(1, 9)):
        try:
            one_edit(session, rng)
            answer = session.solve()
        except (EditError, ConfigError):
            continue
        taken += 1
        if answer.outcome is not None and not np.isfinite(np.asarray(answer.outcome.blur)).all():
            raise ArithmeticError("the blur of an answer is not finite")
        answer.with_sentences()
    session.document.save()
    if session.document.config is not None and load_config(Path(path)) != session.config:
        raise AssertionError("what was saved is not what was edited")
    return 0 if taken else 2


def one_edit(session: Session, rng: np.random.Generator) -> None:
    """A click, a drag, a number typed, or a step back."""
    number = int(rng.integers(max(1, len(session.config.focus))))
    at = rng.uniform(-2, 18), rng.uniform(-2, 14)
    setting = str(rng.choice(["focus", "f_number", "tilt", "swing"]))
    typed = float(rng.choice([0, 1, 2, -1, 1e-6, 1e6, 1e39, math.nan, math.inf, rng.normal(0, 10)]))
    acts: tuple[Callable[[], object], ...] = (
        lambda: session.add_point(*at),
        lambda: session.move_point(number, *at, drag="d"),
        lambda: session.delete_point(number),
        lambda: session.wish_for(
            number,
            str(rng.choice(sorted(WISHES))),
            pixels=typed,
            other=str(rng.choice(["front", "far", ""])),
        ),
        lambda: session.rename(number, str(rng.choice(["", "front", "far", "[/b]", "a" * 400]))),
        lambda: session.set_weight(number, typed),
        lambda: session.set_tolerance(number, typed),
        lambda: session.switch(number, on=bool(rng.integers(2))),
        lambda: session.spread(number, whole=bool(rng.integers(2))),
        lambda: session.free(setting),
        lambda: session.fix(setting, None if rng.random() < 0.5 else typed),
        lambda: session.limit(setting, str(rng.choice(["low", "high"])), typed),
        lambda: session.undo(),
        lambda: session.redo(),
    )
    if session.config.focus or rng.random() < 0.5:
        acts[rng.integers(len(acts))]()
    else:
        acts[0]()


KINDS: tuple[Callable[[Path, np.random.Generator], list[str]], ...] = (
    *(changed_config, changed_config, changed_config, bad_text, bad_mesh, bad_mesh),
    *(bad_lens, bad_photo, bad_camera, bad_batch, bad_export, studio_edits),
)


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


def one_run(seed: int, inputs: Path, folder: Path) -> tuple[str, list[str]]:
    """Kind and outcome of a run, and what is wrong with it."""
    rng = np.random.default_rng(seed)
    shutil.copytree(inputs, folder)
    kind = KINDS[rng.integers(len(KINDS))]
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
    if result.exit_code in (1, 2) and made and kind is not bad_batch:
        wrong.append(
            f"failed ({' '.join(said.split())[-200:]}), and {sorted(p.name for p in out.iterdir())} is there"
        )
    if result.exit_code in (0, 3) and not made and kind is not studio_edits:
        wrong.append("nothing was written")
    wrong += not_finite(out) if made else []
    return f"{kind.__name__}: {STATUSES.get(result.exit_code, 'other')}", wrong


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first run")
    parser.add_argument("--only", type=int, nargs="+", help="seeds to run alone")
    options = parser.parse_args()
    seeds = options.only or range(options.first, options.first + options.runs)
    outcomes: Counter[str] = Counter()
    findings = 0
    with tempfile.TemporaryDirectory() as place:
        inputs = Path(place) / "inputs"
        inputs.mkdir()
        folder_with_inputs(inputs)
        for seed in seeds:
            folder = Path(place) / f"run{seed}"
            outcome, wrong = one_run(seed, inputs, folder)
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
