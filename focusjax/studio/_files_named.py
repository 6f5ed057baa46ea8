"""The files that a config's text names, when it is to be saved in another folder."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_NO_FILES = frozenset({"name", "object", "title", "same_blur_as", "free"})
"""Keys whose texts never name files."""


def name_files_from(tables: Any, old: Path, new: Path, root: Path) -> str:
    """Change the relative paths in `tables` from the folder `old` to the folder `new`.

    Args:
        tables: of a config, changed in place.
        old: the folder in which its paths start.
        new: the folder in which they are to start.
        root: the folder below which the config may name files.

    Returns:
        The first file that lies outside `root`; empty where all are within.
    """
    for table, key, name in _named(tables):
        # Numbered files have # for their digits.
        path = old / name
        if not (path.is_file() or ("#" in path.name and path.parent.is_dir())):
            continue
        if not path.resolve().is_relative_to(root.resolve()):
            return name
        if not Path(name).is_absolute():
            table[key] = path_from(new, path)
    return ""


def path_from(folder: Path, path: Path) -> str:
    """The path from a config's folder to a file, as a config has it."""
    return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()


def texts_in(tables: Any) -> Iterator[str]:
    """The texts that may name files, in tables of a config."""
    return (name for _, _, name in _named(tables))


def _named(value: Any) -> Iterator[tuple[Any, Any, str]]:
    items: Any = ()
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    for key, item in list(items):
        if isinstance(item, str) and key not in _NO_FILES and item.strip():
            yield value, key, item
        else:
            yield from _named(item)
