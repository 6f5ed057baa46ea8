"""Kinds of damage: each changes something in a folder of inputs, and says which command reads it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from _fuzz_damage import change, damage
from _fuzz_inputs import CONFIG, FILM, GLASSES, PROFILE, SENSOR, SHOT

Kind = Callable[[Path, np.random.Generator], list[str]]


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
