"""Kinds of damage: each changes something in a folder of inputs, and says which command reads it."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from _fuzz_inputs import CONFIG, FILM, GLASSES, PROFILE, SENSOR, SHOT

Kind = Callable[[Path, np.random.Generator], list[str]]


ODD_VALUES = (
    *(0, -1, 1, 2, 7, 1e-30, 1e39, -1e39, 1e300, 2**40, 0.5, -0.5, 1e-6, 1e6, 89.9, 360),
    *(math.nan, math.inf, -math.inf, True, False),
    *("", "x", "near", "far", "box.ply", "../../etc/passwd", "[/b]"),
    *([], [0], [0, 0], [0, 0, 0], [1, 2, 3], [math.nan] * 3, [1e20] * 3, [[1, 0, 0, 0]] * 4),
    *({}, {"kind": "x"}),
)


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
    inside = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [each for key, value in inside for each in ((*path, key), *places(value, (*path, key)))]


def change(data: dict[str, Any], rng: np.random.Generator, within: tuple[str, ...] = ()) -> None:
    """Values of a config replaced, removed or repeated, in these tables alone where some are given."""
    for _ in range(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15])):
        found = [path for path in places(data) if not within or path[0] in within]
        if not found:
            return
        path = found[rng.integers(len(found))]
        parent: Any = data
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


def changed_config(folder: Path, rng: np.random.Generator) -> list[str]:
    """Values of the config."""
    data = tomlkit.parse(CONFIG).unwrap()
    change(data, rng)
    (folder / "boxes.toml").write_text(tomlkit.dumps(data))
    return [str(["run", "solve", "render"][rng.integers(3)]), "boxes.toml"]


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
    depth = ["--depth", "depth.npy", "--depth-unit", str(rng.choice(["m", "mm", "1/m"]))]
    length = str(rng.choice(["26", "0", "-1", "nan", "1e9", "50"], p=[0.6, 0.05, 0.05, 0.05, 0.05, 0.2]))
    options = ["--sharp", place, "--f-number", "2", "--focal-length-35mm", length]
    return ["refocus", "photo.png", *depth, *options]


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


def bad_glass(folder: Path, rng: np.random.Generator) -> list[str]:
    damage(folder / "glasses.agf", rng)
    lens = f"{GLASSES[rng.integers(len(GLASSES))].lower()}.zmx"
    return ["lens", lens, "--glass", "glasses.agf"]


def bad_lensfun(folder: Path, rng: np.random.Generator) -> list[str]:
    """A damaged database of lenses, or what the config says of it."""
    data = with_tables(PROFILE)
    if rng.random() < 0.3:
        change(data["lens"]["profile"], rng)
    else:
        damage(folder / "lenses.xml", rng)
        data["lens"]["profile"]["lens"] = str(rng.choice(["One 50mm", "Zoom 20-70mm"]))
    (folder / "boxes.toml").write_text(tomlkit.dumps(data))
    return ["render", "boxes.toml"]


def bad_film(folder: Path, rng: np.random.Generator) -> list[str]:
    """Values of [exposure] and [film], or the curves of a film and its paper."""
    on_film = rng.random() < 0.6
    data = with_tables(FILM if on_film else SENSOR)
    if on_film and rng.random() < 0.3:
        damage(folder / str(rng.choice(["film.csv", "paper.csv"])), rng)
    else:
        change(data, rng, within=("exposure", "film"))
    (folder / "boxes.toml").write_text(tomlkit.dumps(data))
    return [str(rng.choice(["run", "render"])), "boxes.toml"]


def bad_shot(folder: Path, rng: np.random.Generator) -> list[str]:
    """Values of a shot of two frames; one with a shutter now and then."""
    data = with_tables(SHOT + ("[shutter]\nangle_deg = 180\nramp = 0.1\n" if rng.random() < 0.3 else ""))
    change(data, rng, within=("shot", "shutter") if rng.random() < 0.9 else ())
    (folder / "boxes.toml").write_text(tomlkit.dumps(data))
    return ["shot", "boxes.toml"]


def with_tables(text: str) -> dict[str, Any]:
    """The config with more tables."""
    return tomlkit.parse(CONFIG + text).unwrap()


def studio_edits(folder: Path, rng: np.random.Generator) -> list[str]:
    """Nothing to damage: `edit` does what a person does on the page."""
    return [str(folder / "boxes.toml"), str(rng.integers(1 << 30))]


KINDS: tuple[Kind, ...] = (
    *(changed_config, changed_config, changed_config, bad_text, bad_mesh, bad_mesh),
    *(bad_lens, bad_photo, bad_camera, bad_batch, bad_export, studio_edits),
    *(bad_glass, bad_lensfun, bad_film, bad_shot),
)
