"""The folder of a data set: where its files lie, what it is made from, and its manifest."""

import json
import os
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from focusjax import __version__
from focusjax.config import ConfigError
from focusjax.dataset._spec import Spec
from focusjax.io import (
    UNFINISHED,
    FolderInUseError,
    differing_keys,
    json_text,
    load_json,
    replace_file,
    sole_use,
)
from focusjax.many import Journal

MANIFEST = "manifest.jsonl"
"""A line of JSON for each picture: its number, its files and its settings, in the order of numbers."""
ORIGIN = "dataset.json"
"""What all pictures are made from."""
SHARD = 1000
"""Pictures to a folder."""
SETTINGS = ("focus_distance_m", "f_number", "focal_length_m", "sensor_width_m", "seed", "number")
"""Numbers in the file of every picture."""


def picture_file(number: int) -> str:
    """The path of a picture below the folder.

    Example:
        >>> picture_file(12345)
        '012/012345.npz'
    """
    return f"{number // SHARD:03}/{number:06}.npz"


def layers_file(number: int) -> str:
    """The path of its layers."""
    return f"{number // SHARD:03}/{number:06}.layers.exr"


def numbers_in(folder: Path) -> list[int]:
    """The pictures that are there, in order."""
    return sorted(int(path.stem) for path in folder.glob("[0-9]*/[0-9]*.npz") if path.stem.isdecimal())


def save_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write an npz file that is there whole or not at all."""
    new = path.with_name(f"{UNFINISHED}{uuid.uuid4().hex[:8]}-{path.name}")
    try:
        np.savez_compressed(new, **arrays)  # type: ignore[arg-type]
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)


def write_manifest(folder: Path) -> int:
    """Write the manifest of the pictures that are there; returns their number."""
    numbers = numbers_in(folder)
    replace_file(folder / MANIFEST, "".join(json.dumps(_line(folder, k)) + "\n" for k in numbers))
    return len(numbers)


def _line(folder: Path, number: int) -> dict[str, Any]:
    with np.load(folder / picture_file(number)) as stored:
        settings = {name: stored[name].item() for name in SETTINGS}
    files = {"file": picture_file(number)}
    if (folder / layers_file(number)).exists():
        files["layers"] = layers_file(number)
    return {"number": number, **files, **settings}


@contextmanager
def dataset_folder(folder: Path, spec: Spec, *, resume: bool) -> Iterator[None]:
    """The folder made, looked over, and ours alone within the block.

    Raises:
        ConfigError: it holds anything and is not to be resumed, is from another spec or version, is used by
            another run, or cannot be written to.
    """
    origin = json.loads(json_text(_origin(spec)))
    with ExitStack() as held:
        try:
            found = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
            if found:
                _check(folder, found[0], origin, resume=resume)
            folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(sole_use(folder))
            _remove_unfinished(folder)
            replace_file(folder / ORIGIN, json_text(origin))
        except FolderInUseError as error:
            raise ConfigError(str(error)) from None
        except OSError as error:
            raise ConfigError(
                f"folder {folder} cannot be used ({error.strerror}); choose another with --out"
            ) from None
        held.callback(_remove_unfinished, folder)
        yield


def _check(folder: Path, first: str, origin: dict[str, Any], *, resume: bool) -> None:
    """Refuse a folder that holds something else, or the same if that is not to be gone on with."""
    if not resume:
        raise ConfigError(
            f"folder {folder} already holds {first!r}; use --resume to go on with a data set there, or choose"
            " another with --out"
        )
    before = load_json(folder / ORIGIN)
    if not isinstance(before, dict):
        raise ConfigError(f"folder {folder} holds no data set; choose another with --out")
    changed = [key.removeprefix("spec.") for key in differing_keys(before, origin)]
    if changed:
        raise ConfigError(
            f"the data set in {folder} is of another {changed[0]}: its pictures and new ones would not be of"
            " one kind; choose another folder with --out"
        )


def _origin(spec: Spec) -> dict[str, Any]:
    return {"format": 1, "focusjax": __version__, "spec": spec.identity}


def _remove_unfinished(folder: Path) -> None:
    """What a process left that was ended."""
    for pattern in (f"[0-9]*/{UNFINISHED}*", "[0-9]*/.*.new"):
        for path in folder.glob(pattern):
            path.unlink(missing_ok=True)
    Journal(folder, "").clear()
